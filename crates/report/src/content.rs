//! What the grasps hold: the numbers of a [`Content`] in a report, and what they mean.

use eigenhand_synergy::Content;

/// A number of a [`Content`].
pub struct Number {
    /// Name in files.
    pub key: &'static str,
    /// Name on the page, with the unit.
    pub name: &'static str,
    /// Factor from the files' unit to the page's.
    pub factor: f64,
    /// Digits on the page.
    pub digits: usize,
    /// What it means.
    pub meaning: &'static str,
    /// Returns the value.
    pub of: fn(&Content) -> Option<f64>,
}

/// The numbers in a report, in the order of the page.
pub const NUMBERS: [Number; 7] = [
    Number {
        key: "n_postures",
        name: "grasps",
        factor: 1.0,
        digits: 0,
        meaning: "The final evaluation's successes. The numbers below are those of their end postures.",
        of: |content| Some(content.n_postures as f64),
    },
    Number {
        key: "total_variance",
        name: "total variance (rad\u{b2})",
        factor: 1.0,
        digits: 3,
        meaning: "How much the postures vary: the sum of the joints' variances. Near 0, the hand takes almost the same \
                  posture every time.",
        of: |content| Some(content.total_variance),
    },
    Number {
        key: "between_objects",
        name: "share between objects (%)",
        factor: 100.0,
        digits: 1,
        meaning: "How much of this variance the object accounts for. At 100 %, the hand has one posture for each object. If \
                  the object has no effect, the share is still a little above 0.",
        of: |content| content.between_objects,
    },
    Number {
        key: "participation_ratio",
        name: "participation ratio",
        factor: 1.0,
        digits: 1,
        meaning: "In about how many directions the postures vary. The configured number of components does not matter here.",
        of: |content| content.participation_ratio,
    },
    Number {
        key: "naming_accuracy",
        name: "objects named right (%)",
        factor: 100.0,
        digits: 1,
        meaning: "How often the components' coefficients of a held-out posture tell which object it holds.",
        of: |content| content.naming_accuracy,
    },
    Number {
        key: "naming_chance",
        name: "objects named right by chance (%)",
        factor: 100.0,
        digits: 1,
        meaning: "The same without a look at the posture. If the objects are not named more often than this, the coefficients \
                  do not tell the objects apart.",
        of: |content| content.naming_chance,
    },
    Number {
        key: "held_out_contribution",
        name: "contribution to held-out postures (%)",
        factor: 100.0,
        digits: 1,
        meaning: "Share of the variance that the components express in postures to which they were not fitted. A high share \
                  of a small variance says little.",
        of: |content| content.held_out_contribution,
    },
];
