#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| navigation_receivers_fuzz::check(bytes));
