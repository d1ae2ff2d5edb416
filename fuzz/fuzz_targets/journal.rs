#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| ocu_fuzz::recorded::journal(input));
