#![no_main]

#[path = "../lib_fuzzer.rs"]
mod lib_fuzzer;

lib_fuzzer::target!("imports");
