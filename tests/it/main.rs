//! One binary of end-to-end tests.

mod proof;
