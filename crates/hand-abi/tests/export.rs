//! A plugin in Rust, called as the program calls it: through the table alone.
// A helper function of a test fails the test, which is what a panic means here.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::ptr::{null, null_mut};

use eigenhand_hand_abi::{Bytes, Generate, Generated, HandFiles, HandPlugin, MAGIC, STATUS_ERROR, STATUS_OK, Status};

struct Sample;

impl Generate for Sample {
    fn generate(options: &str) -> Result<HandFiles, String> {
        match options {
            "good" => Ok(HandFiles::new().with("hand.toml", "schema = 1").with("meshes/empty.stl", [])),
            "panic" => panic!("on {}", "purpose"),
            other => Err(format!("no hand of {other}")),
        }
    }
}

const TABLE: HandPlugin = HandPlugin::of::<Sample>();

fn generate(options: &[u8]) -> (Status, *mut Generated) {
    let mut out = null_mut();
    // SAFETY: the options live through the call, and `out` is a place for a pointer.
    let status = unsafe { TABLE.generate.unwrap()(options.as_ptr(), options.len(), &mut out) };
    (status, out)
}

fn text(bytes: Bytes) -> String {
    // SAFETY: the bytes come from the table and their hand is not freed yet.
    let slice = unsafe { std::slice::from_raw_parts(bytes.data, bytes.len) };
    String::from_utf8(slice.to_vec()).unwrap()
}

fn message(options: &[u8]) -> String {
    let (status, hand) = generate(options);
    assert_eq!(status, STATUS_ERROR);
    let (mut out, mut count) = (Bytes::NONE, 7);
    // SAFETY: `hand` comes from `generate` and is freed once, after its last use.
    unsafe {
        assert_eq!(TABLE.error_message.unwrap()(hand, &mut out), STATUS_OK);
        assert_eq!(TABLE.file_count.unwrap()(hand, &mut count), STATUS_ERROR, "there are no files");
        let message = text(out);
        TABLE.free.unwrap()(hand);
        message
    }
}

#[test]
fn files_come_out_in_order() {
    assert_eq!(TABLE.header.magic, MAGIC);
    let (status, hand) = generate(b"good");
    assert_eq!(status, STATUS_OK);
    let (mut count, mut name, mut content) = (0, Bytes::NONE, Bytes::NONE);
    // SAFETY: `hand` comes from `generate` and is freed once, after its last use.
    unsafe {
        assert_eq!(TABLE.file_count.unwrap()(hand, &mut count), STATUS_OK);
        assert_eq!(count, 2);
        assert_eq!(TABLE.file.unwrap()(hand, 0, &mut name, &mut content), STATUS_OK);
        assert_eq!((text(name).as_str(), text(content).as_str()), ("hand.toml", "schema = 1"));
        assert_eq!(TABLE.file.unwrap()(hand, 1, &mut name, &mut content), STATUS_OK);
        assert_eq!((text(name).as_str(), content.len), ("meshes/empty.stl", 0));
        assert_eq!(TABLE.file.unwrap()(hand, 2, &mut name, &mut content), STATUS_ERROR, "there is no third");
        assert_eq!(TABLE.error_message.unwrap()(hand, &mut name), STATUS_ERROR, "nothing failed");
        TABLE.free.unwrap()(hand);
    }
}

#[test]
fn a_failure_says_why() {
    assert_eq!(message(b"nothing"), "no hand of nothing");
    assert_eq!(message(b"panic"), "panicked: on purpose");
    assert!(message(&[0xff]).starts_with("the options are not UTF-8"));
}

#[test]
fn null_is_answered_with_a_status() {
    let mut count = 0;
    // SAFETY: null is allowed everywhere here.
    unsafe {
        assert_eq!(TABLE.generate.unwrap()(null(), 0, null_mut()), STATUS_ERROR);
        assert_eq!(TABLE.generate.unwrap()(null(), 3, &mut null_mut()), STATUS_ERROR);
        assert_eq!(TABLE.file_count.unwrap()(null(), &mut count), STATUS_ERROR);
        assert_eq!(TABLE.file.unwrap()(null(), 0, null_mut(), null_mut()), STATUS_ERROR);
        assert_eq!(TABLE.error_message.unwrap()(null(), null_mut()), STATUS_ERROR);
        TABLE.free.unwrap()(null_mut());
    }
}
