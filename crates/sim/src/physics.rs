//! Settings of the integration and of the contacts.

use serde::{Deserialize, Serialize};

use crate::SimError;

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
    /// Sliding (no unit), torsional (m) and rolling (m) friction of the object.
    pub object_friction: [f64; 3],
}

impl PhysicsConfig {
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
        check(
            "physics.object_friction",
            self.object_friction.iter().all(|f| f.is_finite() && *f >= 0.0),
            "three numbers that are not negative",
            format!("{:?}", self.object_friction),
        )
    }
}
