#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    eigenhand_fuzz::inputs::motors(bytes);
});
