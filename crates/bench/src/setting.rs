//! The setting of a measurement, and the median of its pieces.

use std::sync::Arc;
use std::time::Duration;

use eigenhand_hands::{Hand, SearchPath};
use eigenhand_mujoco::MuJoCo;
use eigenhand_train::config::{Layers, Preset, RunConfig};
use eigenhand_train::hand_named;

use crate::error::BenchError;

/// Hand and duration of a measurement.
#[derive(Clone, Debug)]
pub struct BenchSetting {
    /// Name or directory of the hand; if absent, the hand of the default configuration.
    pub hand: Option<String>,
    /// Places that are searched for hands.
    pub hands: SearchPath,
    /// Duration of each measurement.
    pub duration: Duration,
}

impl BenchSetting {
    /// Reads the default configuration with the hand.
    ///
    /// # Errors
    /// [`BenchError::Hand`], or [`BenchError::MuJoCo`] when the library is missing.
    pub(crate) fn load(&self) -> Result<(RunConfig, Hand, Arc<MuJoCo>), BenchError> {
        let mut layers = Layers::new(Preset::Default)?;
        if let Some(hand) = &self.hand {
            layers.set("hand", hand.clone(), "--hand")?;
        }
        let config = layers.resolve()?;
        let hand = hand_named(&config.hand, &self.hands)?;
        Ok((config, hand, MuJoCo::load()?))
    }
}

/// (values) => their median; not a number without values.
pub(crate) fn median(values: &mut [f64]) -> f64 {
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
