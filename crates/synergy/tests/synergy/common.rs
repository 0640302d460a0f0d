//! Joints and postures for the tests.

use eigenhand_synergy::{ActuationMap, JointInfo, Recommended, Space, Synergy, SynergyFile, Unit};

/// Returns `n` joints with wide limits, and with names that file formats must escape.
pub fn joints(n: usize) -> Vec<JointInfo> {
    let odd = ["FFJ3", "ffj3", "it's \"quoted\"", "指/0", "a.b[c]\\d", "object", "rowid", "new\nline", "3f9c#2"];
    (0..n)
        .map(|i| JointInfo {
            name: odd.get(i).map_or_else(|| format!("joint {i}"), |name| (*name).to_owned()),
            unit: if i % 4 == 3 { Unit::Metre } else { Unit::Radian },
            lower: if i % 5 == 4 { f64::NEG_INFINITY } else { -2.0 - i as f64 / 3.0 },
            upper: 2.5 + i as f64 / 7.0,
        })
        .collect()
}

/// Returns deterministic postures with uneven variance of full rank; their numbers need all digits.
pub fn postures(n_postures: usize, n_joints: usize) -> Vec<Vec<f64>> {
    let mut state = 1_u64;
    let mut next = || {
        // Constants of Knuth's MMIX generator.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    (0..n_postures)
        .map(|_| {
            let common: [f64; 2] = [next(), next()];
            (0..n_joints)
                .map(|j| {
                    let angle = j as f64;
                    0.3 * angle.cos() + common[0] * angle.sin() + common[1] * (2.0 * angle).cos() + 0.2 * next()
                })
                .collect()
        })
        .collect()
}

/// Returns a synergy file over `n` joints, and the postures to which it was fitted.
pub fn file(n_postures: usize, n: usize, k: usize) -> (SynergyFile, Vec<Vec<f64>>) {
    let postures = postures(n_postures, n);
    let file = SynergyFile {
        hand: "a \"hand\" of ünusual name".to_owned(),
        space: Space::Postures,
        synergy: Synergy::fit(&joints(n), &postures, k).unwrap(),
        joint_map: None,
        recommended: Some(Recommended { components: 1, reason: "one is \"enough\"".to_owned() }),
        actuation: Some(ActuationMap {
            actuators: vec!["pull".to_owned(), "push\t1".to_owned()],
            control_min: vec![-0.1, f64::NEG_INFINITY],
            control_max: vec![0.3, f64::INFINITY],
            matrix: vec![vec![1.0 / 3.0; n], vec![-0.0; n]],
            offset: vec![1e-300, -1.5],
        }),
        grasps: Vec::new(),
        provenance: [("git.revision", "0123abc"), ("note", "two\nlines")]
            .map(|(key, value)| (key.to_owned(), value.to_owned()))
            .into(),
    };
    (file, postures)
}
