//! One fuzz target; the name of the binary is the end of the file's name.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| lobula_fuzz::read(env!("CARGO_BIN_NAME"), bytes));
