//! What a component does, in words.

use std::collections::BTreeMap;

use eigenhand_hands::{Hand, Transmission};
use eigenhand_synergy::Space;

/// A part of the hand takes part in a component if it has at least this share of the squared loadings.
const TAKES_PART: f64 = 0.1;
/// A finger closes or opens if this share of its squared loadings does so.
const CLEARLY: f64 = 0.75;

/// What a hand says of the coordinates of a space: actuators or joints.
pub struct Words {
    /// Names of the fingers, as their tips are called.
    fingers: Vec<String>,
    /// For each coordinate: its finger.
    finger: BTreeMap<String, usize>,
    /// For each coordinate: 1 if its upper end closes the hand, -1 if its lower end does.
    closing: BTreeMap<String, f64>,
}

impl Words {
    /// Reads what a hand says of the coordinates of a space.
    pub fn of(hand: &Hand, space: Space) -> Words {
        let joints = hand.finger_joints();
        let finger_of = |joint: &str| joints.iter().position(|own| own.iter().any(|name| name == joint));
        let (mut finger, mut closing) = (BTreeMap::new(), BTreeMap::new());
        for actuator in &hand.actuators {
            let terms: Vec<(&str, f64)> = match &actuator.transmission {
                Transmission::Joint(joint) => vec![(joint, actuator.gear)],
                Transmission::FixedTendon { terms, .. } => {
                    terms.iter().map(|(joint, factor)| (joint.as_str(), factor * actuator.gear)).collect()
                }
                Transmission::Other(_) => Vec::new(),
            };
            let sign = hand.manifest.closing.get(&actuator.name).copied();
            match space {
                Space::Commands => {
                    finger.extend(terms.iter().find_map(|(joint, _)| Some((actuator.name.clone(), finger_of(joint)?))));
                    closing.extend(sign.map(|sign| (actuator.name.clone(), sign)));
                }
                Space::Postures => closing.extend(
                    terms.iter().filter_map(|(joint, factor)| Some(((*joint).to_owned(), sign? * factor.signum()))),
                ),
            }
        }
        if let Space::Postures = space {
            finger.extend(hand.joints.iter().filter_map(|joint| Some((joint.name.clone(), finger_of(&joint.name)?))));
            // A chain of couplings settles after as many passes as it has links.
            for _ in &hand.couplings {
                for coupling in &hand.couplings {
                    let sign = coupling.driver.as_ref().and_then(|driver| closing.get(driver)).copied();
                    closing
                        .extend(sign.map(|sign| (coupling.dependent.clone(), sign * coupling.polynomial[1].signum())));
                }
            }
        }
        Words { fingers: finger_names(hand.fingertips.iter().map(|tip| tip.name.as_str())), finger, closing }
    }

    /// Tells whether a coordinate belongs to one finger.
    pub fn is_of_finger(&self, name: &str) -> bool {
        self.finger.contains_key(name)
    }

    /// Names the fingers or coordinates of which a verb is said.
    fn named(&self, verb: &str, parts: &[String]) -> String {
        match parts.len() {
            1 => parts[0].clone(),
            n => {
                let all = n == self.fingers.len() && verb != "moves";
                let names = if all { "all fingers".to_owned() } else { parts.join(", ") };
                let together = if ["closes", "opens"].contains(&verb) { " together" } else { "" };
                format!("{names}{together}")
            }
        }
    }

    /// Says what happens to the hand while the component's number rises.
    pub fn sentence(&self, names: &[&str], loadings: &[f64]) -> String {
        let total: f64 = loadings.iter().map(|x| x * x).sum();
        let mut parts: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for (i, finger) in self.fingers.iter().enumerate() {
            let (mut closes, mut opens, mut other) = (0.0, 0.0, 0.0);
            for (name, loading) in names.iter().zip(loadings).filter(|(name, _)| self.finger.get(**name) == Some(&i)) {
                match self.closing.get(*name).map(|sign| sign * loading) {
                    Some(way) if way > 0.0 => closes += way * way,
                    Some(way) => opens += way * way,
                    None => other += loading * loading,
                }
            }
            let all = closes + opens + other;
            if all < TAKES_PART * total {
                continue;
            }
            let verb = if closes >= CLEARLY * all {
                "closes"
            } else if opens >= CLEARLY * all {
                "opens"
            } else if other >= CLEARLY * all {
                "turns"
            } else {
                "reshapes"
            };
            parts.entry(verb).or_default().push(finger.clone());
        }
        for (name, loading) in names.iter().zip(loadings) {
            if !self.finger.contains_key(*name) && loading * loading >= TAKES_PART * total {
                parts.entry("moves").or_default().push((*name).to_owned());
            }
        }
        let said: Vec<String> = ["closes", "opens", "turns", "reshapes", "moves"]
            .iter()
            .filter_map(|verb| Some(format!("{verb} {}", self.named(verb, parts.get(verb)?))))
            .collect();
        if said.is_empty() { "moves many joints a little".to_owned() } else { said.join("; ") }
    }
}

/// Words in the name of a fingertip that do not tell which finger it is.
const OF_ANY_TIP: [&str; 8] = ["fingertip", "tip", "site", "link", "distal", "end", "frame", "pad"];

/// Names fingers as their tips, without an ending that all of them have, and without the words that any tip can have. A
/// finger of which nothing is left but a number is called by its place.
fn finger_names<'a>(tips: impl Iterator<Item = &'a str> + Clone) -> Vec<String> {
    let ending = ["_fingertip", "fingertip", "_tip", "tip", "_site"]
        .into_iter()
        .find(|ending| tips.clone().all(|tip| tip.strip_suffix(ending).is_some_and(|rest| !rest.is_empty())));
    let bare = tips.map(|tip| ending.and_then(|ending| tip.strip_suffix(ending)).unwrap_or(tip));
    let bare: Vec<&str> = bare.collect();
    let is_number = |word: &str| {
        let digits = word.strip_prefix(['l', 'L']).unwrap_or(word);
        !digits.is_empty() && digits.chars().all(|c| c.is_ascii_digit())
    };
    let name = |(i, tip): (usize, &&str)| {
        let tells = |word: &&str| !OF_ANY_TIP.contains(&word.to_lowercase().as_str()) && !is_number(word);
        let words: Vec<&str> = tip.split('_').filter(tells).collect();
        if words.is_empty() { format!("finger {}", i + 1) } else { words.join("_") }
    };
    let named: Vec<String> = bare.iter().enumerate().map(name).collect();
    let unlike = named.iter().enumerate().all(|(i, name)| !named[..i].contains(name));
    if unlike { named } else { bare.into_iter().map(str::to_owned).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words() -> Words {
        let of = |pairs: &[(&str, usize)]| pairs.iter().map(|(name, i)| ((*name).to_owned(), *i)).collect();
        Words {
            fingers: finger_names(["index_tip", "thumb_tip"].into_iter()),
            finger: of(&[("bend", 0), ("curl", 0), ("spread", 0), ("thumb", 1)]),
            closing: [("bend", 1.0), ("curl", -1.0), ("thumb", 1.0)].map(|(n, s)| (n.to_owned(), s)).into(),
        }
    }

    #[test]
    fn a_component_is_told_in_words() {
        let names = ["bend", "curl", "spread", "thumb", "wrist"];
        let say = |loadings: [f64; 5]| words().sentence(&names, &loadings);
        assert_eq!(say([0.6, -0.5, 0.1, 0.6, 0.0]), "closes all fingers together");
        assert_eq!(say([0.6, -0.5, 0.0, -0.6, 0.0]), "closes index; opens thumb");
        assert_eq!(say([0.0, 0.0, 1.0, 0.0, 0.0]), "turns index");
        assert_eq!(say([0.6, 0.6, 0.0, 0.0, 0.5]), "reshapes index; moves wrist");
        assert_eq!(finger_names(["ff", "tip"].into_iter()), ["ff", "finger 2"]);
        let leap = ["fingertip_site", "fingertip_2_tip", "thumb_fingertip_site"];
        assert_eq!(finger_names(leap.into_iter()), ["finger 1", "finger 2", "thumb"]);
        assert_eq!(finger_names(["index_L2_tip", "middle_L2_tip"].into_iter()), ["index", "middle"]);
        assert_eq!(finger_names(["left_pad", "left_end"].into_iter()), ["left_pad", "left_end"]);
    }
}
