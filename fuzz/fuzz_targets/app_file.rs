#![no_main]

#[path = "../src/app.rs"]
mod app;

use ocu_fuzz as targets;

libfuzzer_sys::fuzz_target!(|input: &[u8]| app::app_file(input));
