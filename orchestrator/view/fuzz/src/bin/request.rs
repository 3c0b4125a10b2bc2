#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| view_fuzz::check(bytes));
