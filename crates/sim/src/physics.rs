//! Settings of the integration and of the contacts.

use serde::{Deserialize, Serialize};

use crate::{Object, SimError};

/// Shape of the friction cone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cone {
    /// Four-sided approximation, MuJoCo's default.
    Pyramidal,
    /// The true cone; grasps slip less in it.
    Elliptic,
}

/// Settings of the simulation, written into every scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhysicsConfig {
    /// Integration step in s.
    pub timestep: f64,
    /// Number of integration steps in a control step.
    pub substeps: usize,
    /// Friction cone.
    pub cone: Cone,
    /// Ratio of frictional to normal constraint impedance.
    pub impratio: f64,
    /// Iterations of the no-slip solver, which runs after the constraint solver.
    pub noslip_iterations: usize,
    /// Largest number of iterations of the constraint solver.
    pub solver_iterations: usize,
    /// Lowest and highest sliding friction of the object's contacts; drawn uniformly for each episode.
    pub friction: [f64; 2],
    /// Torsional friction of the object's contacts, in m.
    pub torsional_friction: f64,
    /// Rolling friction of the object's contacts, in m.
    pub rolling_friction: f64,
    /// Whether the links of the hand collide with one another.
    pub self_collision: bool,
}

impl PhysicsConfig {
    /// Returns the sliding, torsional and rolling friction of an object; `drawn` is the sliding friction of an object
    /// that has none of its own.
    pub(crate) fn friction_of(&self, object: &Object, drawn: f64) -> [f64; 3] {
        [object.friction.unwrap_or(drawn), self.torsional_friction, self.rolling_friction]
    }

    /// Returns the duration of a control step in s.
    pub fn control_period(&self) -> f64 {
        self.timestep * self.substeps as f64
    }

    /// Checks every setting.
    ///
    /// # Errors
    /// [`SimError::Setting`] names the first key that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        let check = |name, good: bool, expected, got: String| {
            if good { Ok(()) } else { Err(SimError::Setting { name, expected, got }) }
        };
        check(
            "physics.timestep",
            self.timestep > 0.0 && self.timestep <= 0.02,
            "a number of seconds above 0 and at most 0.02",
            self.timestep.to_string(),
        )?;
        check(
            "physics.substeps",
            (1..=1000).contains(&self.substeps),
            "a whole number from 1 to 1000",
            self.substeps.to_string(),
        )?;
        check(
            "physics.impratio",
            self.impratio.is_finite() && self.impratio > 0.0,
            "a positive number",
            self.impratio.to_string(),
        )?;
        check(
            "physics.solver_iterations",
            (1..=1000).contains(&self.solver_iterations),
            "a whole number from 1 to 1000",
            self.solver_iterations.to_string(),
        )?;
        check(
            "physics.noslip_iterations",
            self.noslip_iterations <= 1000,
            "a whole number up to 1000",
            self.noslip_iterations.to_string(),
        )?;
        let [low, high] = self.friction;
        check(
            "physics.friction",
            0.0 <= low && low <= high && high.is_finite(),
            "two numbers that are not negative, the lower first",
            format!("{:?}", self.friction),
        )?;
        let length = "a number of m that is not negative";
        let good = |friction: f64| friction >= 0.0 && friction.is_finite();
        let torsional = self.torsional_friction;
        check("physics.torsional_friction", good(torsional), length, torsional.to_string())?;
        check("physics.rolling_friction", good(self.rolling_friction), length, self.rolling_friction.to_string())
    }
}
