//! The content of labelled postures: against scikit-learn's numbers, in closed form, and on degenerate input.

use crate::common::postures;
use eigenhand_synergy::{Content, Synergy, SynergyError};

#[derive(serde::Deserialize)]
struct Fixture {
    k: usize,
    joints: Vec<usize>,
    total_variance: f64,
    between_objects: f64,
    between_objects_adjusted: f64,
    participation_ratio: f64,
    naming_accuracy: f64,
    held_out_contribution: f64,
    postures: Vec<(String, Vec<f64>)>,
}

#[track_caller]
fn assert_near(got: impl Into<Option<f64>>, expected: f64) {
    let got = got.into().unwrap();
    assert!((got - expected).abs() < 1e-12, "{got}, expected {expected}");
}

/// Labels postures with `names`, one name for each of `counts`.
fn labelled<const G: usize>(counts: [usize; G], postures: Vec<Vec<f64>>) -> Vec<(usize, Vec<f64>)> {
    let objects = counts.iter().enumerate().flat_map(|(object, &n)| std::iter::repeat_n(object, n));
    objects.zip(postures).collect()
}

fn content(postures: &[(usize, Vec<f64>)], joints: &[usize], k: usize) -> Content {
    let named: Vec<(String, &Vec<f64>)> = postures.iter().map(|(o, q)| (format!("object {o}"), q)).collect();
    Content::new(&named, joints, k).unwrap()
}

#[test]
fn agrees_with_scikit_learn() {
    let expected: Fixture = toml::from_str(include_str!("../data/content.toml")).unwrap();
    let found = Content::new(&expected.postures, &expected.joints, expected.k).unwrap();
    assert_near(found.total_variance, expected.total_variance);
    assert_near(found.between_objects, expected.between_objects);
    assert_near(found.between_objects_adjusted, expected.between_objects_adjusted);
    assert_near(found.participation_ratio, expected.participation_ratio);
    assert_near(found.naming_accuracy, expected.naming_accuracy);
    assert_near(found.held_out_contribution, expected.held_out_contribution);
    assert_eq!((found.n_postures, found.n_joints, found.n_components), (61, 5, 2));
    assert_eq!((found.n_objects, found.n_named_objects), (4, 3), "seven pens are too few to be named");
    assert_near(found.naming_chance, 1.0 / 3.0);
}

#[test]
fn two_objects_in_closed_form() {
    // Means at 0 and 2, each posture 0.5 from its mean; the second joint varies by itself, the third is left out.
    let grasps: Vec<(usize, Vec<f64>)> = [(0, -0.5, 1.0), (0, 0.5, 1.0), (1, 1.5, -1.0), (1, 2.5, -1.0)]
        .map(|(object, a, b)| (object, vec![7.0 + a, a * b, b]))
        .to_vec();
    let one = content(&grasps, &[0], 1);
    assert_near(one.total_variance, 5.0 / 3.0);
    assert_near(one.between_objects, 4.0 / 5.0);
    // 1 - (1 - 4/5) (4 - 1) / (4 - 2)
    assert_near(one.between_objects_adjusted, 0.7);
    assert_near(one.participation_ratio, 1.0);
    assert_eq!((one.naming_accuracy, one.naming_chance, one.held_out_contribution), (None, None, None));

    // Equal variances along m uncorrelated joints have the participation ratio m, and 3 to 1 that of 16 / 10.
    let cross = |sizes: &[f64]| -> Vec<(usize, Vec<f64>)> {
        let signs = sizes.iter().enumerate().flat_map(|(i, size)| [(i, *size), (i, -size)]);
        signs.map(|(i, q)| (0, (0..sizes.len()).map(|j| if i == j { q } else { 0.0 }).collect())).collect()
    };
    assert_near(content(&cross(&[0.3; 4]), &[0, 1, 2, 3], 1).participation_ratio, 4.0);
    assert_near(content(&cross(&[3f64.sqrt(), 1.0]), &[0, 1], 1).participation_ratio, 1.6);
}

#[test]
fn without_an_effect_the_adjusted_share_is_zero_on_average() {
    // All ways to give six different postures to three objects, two each: every way is as likely.
    let six = postures(6, 4);
    let (mut share, mut adjusted, mut n) = (0.0, 0.0, 0.0);
    for code in 0..3_usize.pow(6) {
        let objects: Vec<usize> = (0..6).map(|i| code / 3_usize.pow(i) % 3).collect();
        if (0..3).all(|object| objects.iter().filter(|o| **o == object).count() == 2) {
            let grasps: Vec<(usize, Vec<f64>)> = objects.into_iter().zip(six.clone()).collect();
            let found = content(&grasps, &[0, 1, 2, 3], 1);
            share += found.between_objects.unwrap();
            adjusted += found.between_objects_adjusted.unwrap();
            n += 1.0;
        }
    }
    assert_eq!(n, 90.0);
    assert_near(share / n, 2.0 / 5.0);
    assert_near(adjusted / n, 0.0);
}

#[test]
fn separated_objects_are_named_and_objects_alike_only_by_chance() {
    let counts = [150, 60, 30];
    let alike = labelled(counts, postures(240, 5));
    let found = content(&alike, &[0, 1, 2, 3, 4], 2);
    assert_near(found.naming_chance, 1.0 / 3.0);
    let accuracy = found.naming_accuracy.unwrap();
    assert!((accuracy - 1.0 / 3.0).abs() < 0.1, "{accuracy}: 0.625 would be the share of the largest object");
    assert!(found.between_objects.unwrap() < 0.02 && found.between_objects_adjusted.unwrap().abs() < 0.02);

    let mut apart = alike.clone();
    apart.iter_mut().for_each(|(object, q)| q[3] += 4.0 * *object as f64);
    let found = content(&apart, &[0, 1, 2, 3, 4], 2);
    assert_eq!(found.naming_accuracy, Some(1.0));
    assert!(found.between_objects.unwrap() > 0.9);
    let without = content(&apart, &[0, 1, 2, 4], 2);
    let same = content(&alike, &[0, 1, 2, 4], 2);
    assert_eq!(without, same, "a joint that does not count changes nothing");

    // The object moves a joint that varies less than another, so that the first component does not see it.
    let minor: Vec<(usize, Vec<f64>)> = (0..80)
        .map(|i| (i % 2, vec![2.0 * ((i / 2) as f64 * 2.3).sin(), 0.8 * (i % 2) as f64 + 0.1 * (i as f64 * 1.7).cos()]))
        .collect();
    let [one, two] = [1, 2].map(|k| content(&minor, &[0, 1], k).naming_accuracy.unwrap());
    assert!(one < 0.75 && two == 1.0, "{one} {two}");
}

#[test]
fn the_order_of_the_objects_does_not_matter() {
    let grasps = labelled([13, 24, 11], postures(48, 5));
    let mut moved: Vec<(usize, Vec<f64>)> =
        (0..3).rev().flat_map(|o| grasps.iter().filter(move |g| g.0 == o)).cloned().collect();
    assert_eq!(content(&moved, &[0, 1, 2, 3], 2), content(&grasps, &[0, 1, 2, 3], 2));
    moved[0].0 = 1;
    assert_ne!(content(&moved, &[0, 1, 2, 3], 2), content(&grasps, &[0, 1, 2, 3], 2));
}

#[test]
fn a_held_out_contribution_is_not_flattered_by_few_postures() {
    let all = [0, 1, 2, 3, 4, 5, 6, 7];
    let few = labelled([12], postures(12, 8));
    let fitted: Vec<&Vec<f64>> = few.iter().map(|(_, q)| q).collect();
    let in_sample = Synergy::fit(&crate::common::joints(8), &fitted, 4).unwrap().contribution_sum();
    let held_out = content(&few, &all, 4).held_out_contribution.unwrap();
    assert!(held_out < in_sample - 0.02, "{held_out} {in_sample}");
    // What lies in the components is found again, whatever the fold.
    let line: Vec<Vec<f64>> = (0..12).map(|i| vec![0.1 * f64::from(i * i), 0.3 - 0.2 * f64::from(i * i)]).collect();
    assert_near(content(&labelled([12], line), &[0, 1], 1).held_out_contribution, 1.0);
    assert_near(content(&few, &all, 8).held_out_contribution, 1.0);
    assert_eq!(content(&few, &all, 99).n_components, 8);
}

#[test]
fn degenerate_sets_give_no_number_or_zero() {
    let of = |postures: &[(usize, Vec<f64>)]| content(postures, &[0, 1], 1);
    let nothing = Content {
        n_postures: 0,
        n_objects: 0,
        n_joints: 2,
        n_components: 1,
        total_variance: 0.0,
        between_objects: None,
        between_objects_adjusted: None,
        participation_ratio: None,
        n_named_objects: 0,
        naming_accuracy: None,
        naming_chance: None,
        held_out_contribution: None,
    };
    assert_eq!(of(&[]), nothing);
    let one = of(&[(0, vec![0.1, 0.3])]);
    assert_eq!(one, Content { n_postures: 1, n_objects: 1, ..nothing.clone() });

    // Thirty equal postures do not vary, though their mean is rounded. All classes are equally near.
    let still = of(&labelled([20, 10], vec![vec![0.1, 0.3]; 30]));
    let expected = Content {
        n_postures: 30,
        n_objects: 2,
        n_named_objects: 2,
        naming_accuracy: Some(0.5),
        naming_chance: Some(0.5),
        ..nothing
    };
    assert_eq!(still, expected);

    let single = of(&labelled([20], postures(20, 2)));
    assert_eq!((single.between_objects, single.naming_accuracy, single.n_objects), (None, None, 1));
    assert!(single.held_out_contribution.is_some() && single.participation_ratio.is_some());
    let each_its_own = of(&labelled([1, 1, 1], postures(3, 2)));
    assert_near(each_its_own.between_objects, 1.0);
    assert_eq!(each_its_own.between_objects_adjusted, None);

    // Nine folds need more postures than components, and each object a posture in each fold.
    let counts = |counts: [usize; 2], k| {
        let found = content(&labelled(counts, postures(40, 30)), &Vec::from_iter(0..30), k);
        (found.naming_accuracy.is_some(), found.held_out_contribution.is_some())
    };
    assert_eq!([counts([10, 10], 17), counts([10, 10], 18)], [(true, true), (false, false)]);
    assert_eq!(
        [counts([10, 9], 1), counts([5, 5], 1), counts([5, 4], 1)],
        [(false, true), (false, true), (false, false)]
    );
}

#[test]
fn bad_input_is_refused() {
    let good = labelled([3, 3], postures(6, 3));
    let fail = |postures: &[(usize, Vec<f64>)], joints: &[usize], k| {
        let named: Vec<(&str, &Vec<f64>)> = postures.iter().map(|(_, q)| ("cube", q)).collect();
        Content::new(&named, joints, k).unwrap_err()
    };
    for (joints, part) in
        [(vec![], "at least one"), (vec![0, 3], "no joint 3"), (vec![2, 0, 2], "index 2 occurs twice")]
    {
        let message = fail(&good, &joints, 1).to_string();
        assert!(message.contains(part), "{message}");
    }
    assert!(matches!(fail(&good, &[0], 0), SynergyError::NoComponents));
    let mut bad = good.clone();
    bad[4].1[1] = f64::INFINITY;
    assert!(matches!(fail(&bad, &[0], 1), SynergyError::NonFinitePosture { row: 4, column: 1, .. }));
    bad[4].1[1] = f64::MAX;
    assert!(matches!(fail(&bad, &[1], 1), SynergyError::Decomposition { .. }));
    bad[4].1.pop();
    assert!(matches!(fail(&bad, &[0], 1), SynergyError::PostureLength { row: 4, expected: 3, got: 2 }));
}
