//! Client of lobulad: subscribe, wait, control.
