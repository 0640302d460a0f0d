//! How fast a run simulates.

/// Steps and seconds of the last cycles; those of earlier ones fade.
#[derive(Default)]
pub(crate) struct Speed {
    steps: f64,
    seconds: f64,
}

impl Speed {
    /// What a cycle counts after the next.
    const KEPT: f64 = 0.95;

    /// (steps and seconds of a further cycle) => steps a second
    pub fn after(&mut self, steps: f64, seconds: f64) -> f64 {
        self.steps = Self::KEPT * self.steps + steps;
        self.seconds = Self::KEPT * self.seconds + seconds;
        self.steps / self.seconds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_slow_cycle_changes_the_speed_little() {
        let mut speed = Speed::default();
        assert_eq!(speed.after(200.0, 1.0), 200.0);
        (0..100).for_each(|_| _ = speed.after(200.0, 1.0));
        // An evaluation takes a cycle's time ten times.
        let slow = speed.after(200.0, 10.0);
        assert!(slow > 130.0 && slow < 150.0, "{slow}");
        assert!((0..200).map(|_| speed.after(100.0, 1.0)).last().is_some_and(|now| (now - 100.0).abs() < 1.0));
    }
}
