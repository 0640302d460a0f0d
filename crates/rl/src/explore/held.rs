//! Random actions that are held for some steps.

use rand::{Rng, RngExt};

use super::config::{ActionDimension, Coordination, ExplorationConfig, SPREAD};

/// Random actions of one episode.
#[derive(Clone, Debug)]
pub(super) struct HeldActions {
    values: Vec<f32>,
    groups: Vec<HoldGroup>,
    coordinated_probability: f32,
    coordinated_hold: f32,
    /// Empty if there are no coordinated actions.
    coordination: Vec<Coordination>,
}

/// Dimensions whose random actions start and end together.
#[derive(Clone, Debug)]
struct HoldGroup {
    dimensions: Vec<usize>,
    start_probability: f32,
    end_probability: f32,
    holding: bool,
    /// Whether the held action moves dimensions together.
    together: bool,
}

impl HeldActions {
    /// Prepares random actions that start with the configured probability.
    pub fn now_and_then(config: &ExplorationConfig, act_dim: usize) -> Self {
        Self::new(config, act_dim, |hold_scale| config.random_probability / hold_scale)
    }

    /// Prepares random actions that follow one another without a pause.
    pub fn always(config: &ExplorationConfig, act_dim: usize) -> Self {
        Self::new(config, act_dim, |_| 1.0)
    }

    fn new(config: &ExplorationConfig, act_dim: usize, start_probability: impl Fn(f32) -> f32) -> Self {
        let known = &config.dimensions;
        assert!(known.is_empty() || known.len() == act_dim, "{} dimensions for {act_dim} actions", known.len());
        let scale = |d: usize| known.get(d).copied().unwrap_or_default().hold_scale;
        let mut groups: Vec<(f32, HoldGroup)> = Vec::new();
        for d in 0..act_dim {
            if let Some((_, group)) = groups.iter_mut().find(|(s, _)| *s == scale(d)) {
                group.dimensions.push(d);
                continue;
            }
            let group = HoldGroup {
                dimensions: vec![d],
                start_probability: start_probability(scale(d)),
                end_probability: 1.0 / (config.random_hold_steps * scale(d)),
                holding: false,
                together: false,
            };
            groups.push((scale(d), group));
        }
        let coordinated: &[ActionDimension] = if config.is_coordinated() { known } else { &[] };
        Self {
            values: vec![0.0; act_dim],
            groups: groups.into_iter().map(|(_, group)| group).collect(),
            coordinated_probability: config.coordinated_probability,
            coordinated_hold: config.coordinated_hold,
            coordination: coordinated.iter().map(|dimension| dimension.coordination).collect(),
        }
    }

    /// Replaces the values of an action by those that are held at its step.
    pub fn replace(&mut self, action: &mut [f32], rng: &mut impl Rng) {
        for group in &mut self.groups {
            let longer = if group.together { self.coordinated_hold } else { 1.0 };
            group.holding = group.holding && rng.random::<f32>() >= group.end_probability / longer;
            if !group.holding && rng.random::<f32>() < group.start_probability {
                group.holding = true;
                for &d in &group.dimensions {
                    self.values[d] = rng.random_range(-1.0..=1.0);
                }
                if !self.coordination.is_empty() {
                    let probability = self.coordinated_probability;
                    group.together = coordinate(group, &self.coordination, probability, &mut self.values, rng);
                }
            }
            if group.holding {
                for &d in &group.dimensions {
                    action[d] = self.values[d];
                }
            }
        }
    }
}

/// Makes the random action of a group a coordinated one, with some probability. Returns whether dimensions of the group now
/// move together.
fn coordinate(
    group: &HoldGroup,
    coordination: &[Coordination],
    probability: f32,
    values: &mut [f32],
    rng: &mut impl Rng,
) -> bool {
    let coordinated = rng.random::<f32>() < probability;
    let shared: f32 = rng.random_range(-1.0..=1.0);
    for &d in group.dimensions.iter().filter(|_| coordinated) {
        values[d] = match coordination[d] {
            Coordination::Free => values[d],
            Coordination::Together(sign) => (sign * shared + SPREAD * values[d]).clamp(-1.0, 1.0),
            Coordination::Ends => 1.0_f32.copysign(values[d]),
        };
    }
    coordinated && group.dimensions.iter().any(|&d| matches!(coordination[d], Coordination::Together(_)))
}
