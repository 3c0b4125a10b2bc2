#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| motion_capture_fuzz::check(bytes));
