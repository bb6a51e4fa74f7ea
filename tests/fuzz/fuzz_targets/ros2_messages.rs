#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| city3d_fuzz::ros2_messages(data));
