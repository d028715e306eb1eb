//! The daemon as a library, so that one binary can also serve.
