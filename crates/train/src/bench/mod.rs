//! Speed of the simulation, of the learner and of both together.
//!
//! What is compared runs in turn, in short pieces of one process, and a ratio is the median over the pieces: on a
//! machine with other work, ratios can be trusted and rates cannot.

mod allocations;
mod learner;
mod peak;
mod peers;
mod sim;
mod training;

use std::path::PathBuf;
use std::time::Duration;

use eigenhand_hands::Hand;
use eigenhand_sim::ffi::MuJoCo;

use crate::TrainError;
use crate::catalogue::hand_named;
use crate::config::{Layers, Preset, RunConfig};

pub use allocations::{AllocationCounts, Counter, Work, allocations};
pub use learner::{LearnerSpeed, learner_speed};
pub use peers::{PYTHON_VARIABLE, Peer, PeerKind, PeerSpeed, find_peers};
pub use sim::{SimSpeed, sim_speed};
pub use training::{TrainingMemory, TrainingSpeed, WorkersSpeed, training_memory, training_speed};

/// What is measured, and for how long.
#[derive(Clone, Debug)]
pub struct BenchSetting {
    /// Name or directory of the hand; absent: that of the default configuration.
    pub hand: Option<String>,
    /// Further directories of plugins.
    pub plugins: Vec<PathBuf>,
    /// Time that each measurement takes.
    pub duration: Duration,
}

impl BenchSetting {
    /// Reads the default configuration with the hand.
    ///
    /// # Errors
    /// [`TrainError::Hand`], or a missing library.
    fn load(&self) -> Result<(RunConfig, Hand, std::sync::Arc<MuJoCo>), TrainError> {
        let mut layers = Layers::new(Preset::Default)?;
        if let Some(hand) = &self.hand {
            layers.set("hand", hand.clone(), "--hand")?;
        }
        let config = layers.resolve()?;
        let hand = hand_named(&config.hand, &self.plugins)?;
        Ok((config, hand, MuJoCo::load()?))
    }
}

/// (values) => their median; not a number where there is none.
fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    match (values.len(), values.len() / 2) {
        (0, _) => f64::NAN,
        (n, half) if n % 2 == 1 => values[half],
        (_, half) => (values[half - 1] + values[half]) / 2.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_in_the_middle() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&mut []).is_nan());
    }
}
