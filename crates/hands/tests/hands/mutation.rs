//! Damaged files are errors or hands, never a panic.

use proptest::prelude::*;

use crate::fixture::{DRIVES, Fixture, MANIFEST, MODEL};

/// Pieces that are likely to lead a parser astray.
pub const PIECES: &[&str] = &[
    "",
    "\"",
    "[",
    "]",
    "=",
    "\n",
    "<",
    ">",
    "/>",
    "</",
    "&",
    "..",
    "-",
    "nan",
    "1e999",
    "0 0",
    "name=\"\"",
    "schema = 1\n",
    "<include file=\"pincer.xml\"/>",
    "<!--",
    "class=\"far\"",
    "limited=\"auto\"",
    "é",
    "\u{0}",
    "<default class=\"far\">",
    "9223372036854775808",
];

/// Replaces stretches of `text`, each at a place and of a length, by a piece.
pub fn mutate(text: &str, pieces: &[&str], edits: &[(usize, usize, usize)]) -> String {
    let mut chars: Vec<char> = text.chars().collect();
    for &(at, length, piece) in edits {
        let start = at % (chars.len() + 1);
        let end = (start + length).min(chars.len());
        chars.splice(start..end, pieces[piece % pieces.len()].chars());
    }
    chars.into_iter().collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_hands_never_panic(
        which in 0..3_usize,
        edits in prop::collection::vec((any::<usize>(), 0..12_usize, any::<usize>()), 1..5),
    ) {
        let (name, text) = [("hand.toml", MANIFEST), ("pincer.xml", MODEL), ("drives.xml", DRIVES)][which];
        let files = Fixture::new();
        std::fs::write(files.path(name), mutate(text, PIECES, &edits)).unwrap();
        match files.load() {
            Ok(hand) => {
                let map = hand.actuation();
                prop_assert!(map.control(&hand.open_posture_vector()).iter().all(|c| c.is_finite()));
                prop_assert!(serde_json::to_string(&eigenhand_hands::HandSummary::of(&hand)).is_ok());
            }
            Err(error) => prop_assert!(error.to_string().contains(files.directory.to_str().unwrap())),
        }
    }
}
