//! Whether a new hand can grasp, and if not, the likeliest reason.

use eigenhand_hands::ScriptedGrasps;

use super::NewHandReport;
use crate::trial::Tally;

/// Opening in m below which no object of the usual sizes fits between the fingertips.
const NARROW: f64 = 0.015;

impl NewHandReport {
    /// Keeps what became of the scripted grasps at the chosen place.
    pub(super) fn take(&mut self, grasps: &Tally) {
        (self.tried, self.lifted, self.reached) = (grasps.tried, grasps.lifted, grasps.reached);
        (self.missed, self.drag_m) = (grasps.missed, grasps.drag);
    }

    /// Returns what `hand.toml` keeps of the scripted grasps.
    pub(super) fn scripted_grasps(&self) -> ScriptedGrasps {
        ScriptedGrasps { tried: self.tried, lifted: self.lifted, reached: self.reached }
    }

    /// Tells in one line whether the hand can grasp.
    pub fn verdict(&self) -> String {
        self.scripted_grasps().verdict()
    }

    /// Tells whether the hand can grasp and keeps the hand contract.
    pub fn is_usable(&self) -> bool {
        self.scripted_grasps().can_grasp() && self.broken.is_empty()
    }

    /// Returns the likeliest reason why the hand cannot grasp, and what to do; none if it can.
    pub fn likeliest_reason(&self) -> Option<String> {
        if self.scripted_grasps().can_grasp() {
            return None;
        }
        let approach = "give its palm with --palm, or its approach with --approach, such as --approach +z; the picture of \
                        `hands check` shows how it hangs";
        Some(if let Some(first) = self.broken.first() {
            format!("the hand fails the hand contract: {first}")
        } else if self.close_up.is_empty() && self.close_down.is_empty() {
            format!("no actuator was found to close the hand: {approach}")
        } else if self.fingertips.len() < 2 {
            "one fingertip alone cannot grasp: the other fingers need joints and collision geometry".to_owned()
        } else if self.opening_m < NARROW {
            format!(
                "the fingertips of the open hand are only {:.1} cm apart: set [open_posture] in hand.toml, or check the \
                 ranges of the joints",
                100.0 * self.opening_m
            )
        } else if 2 * self.missed > self.tried {
            format!("in {} of {} grasps the closed hand touches no object: {approach}", self.missed, self.tried)
        } else if let Some(first) = self.symptoms.first() {
            first.to_string()
        } else {
            let slipped = self.tried - self.missed - self.lifted;
            format!(
                "in {slipped} of {} grasps the hand touches the object and loses it: its fingers do not close against each \
                 other, or are too weak. Check [closing] in hand.toml and the force limits of its servos, or {approach}",
                self.tried
            )
        })
    }
}
