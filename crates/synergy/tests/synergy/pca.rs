//! The analysis against NumPy's numbers and against its own definition.

use crate::common::{joints, postures};
use eigenhand_synergy::{JointInfo, Synergy, SynergyError, Unit, cumulative_explained_variance};
use proptest::prelude::*;

#[derive(serde::Deserialize)]
struct Fixture {
    k: usize,
    postures: Vec<Vec<f64>>,
    mean: Vec<f64>,
    eigenvalues: Vec<f64>,
    components: Vec<Vec<f64>>,
    contribution: Vec<f64>,
    coefficient_min: Vec<f64>,
    coefficient_max: Vec<f64>,
    errors: Vec<f64>,
}

fn fixture() -> Fixture {
    toml::from_str(include_str!("../data/pca.toml")).unwrap()
}

#[track_caller]
fn assert_close(got: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(got.len(), expected.len());
    for (i, (got, expected)) in got.iter().zip(expected).enumerate() {
        assert!((got - expected).abs() <= tolerance, "number {i}: {got}, expected {expected}");
    }
}

#[test]
fn the_ranges_of_the_coefficients_include_further_postures() {
    let mut synergy = Synergy::fit(&joints(2), &[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], 1).unwrap();
    assert_eq!((synergy.coefficient_min(), synergy.coefficient_max()), (&[-1.0][..], &[1.0][..]));
    synergy.widen(&[[1.5, 0.5], [4.0, -1.0]]);
    assert_eq!((synergy.coefficient_min(), synergy.coefficient_max()), (&[-1.0][..], &[3.0][..]));
}

#[test]
fn agrees_with_numpy() {
    let numpy = fixture();
    let joints = joints(numpy.mean.len());
    let fitted = Synergy::fit(&joints, &numpy.postures, numpy.k).unwrap();
    // Older postures, which a window leaves out.
    let mut longer = vec![vec![0.5; joints.len()]; 3];
    longer.extend(numpy.postures.iter().cloned());
    let newest = Synergy::fit_newest(&joints, &longer, numpy.k, numpy.postures.len()).unwrap().unwrap();
    assert!(Synergy::fit_newest(&joints, &longer, numpy.k, 0).unwrap().unwrap() != fitted);
    assert!(Synergy::fit_newest(&joints, &longer, numpy.k, numpy.k).unwrap().is_none());
    for synergy in [fitted, newest] {
        assert_eq!((synergy.n_components(), synergy.n_postures()), (numpy.k, numpy.postures.len()));
        assert_close(synergy.mean(), &numpy.mean, 1e-14);
        assert_close(synergy.eigenvalues(), &numpy.eigenvalues, 1e-13);
        assert_close(synergy.explained_variance(), &numpy.eigenvalues[..numpy.k], 1e-13);
        assert_close(synergy.components(), &numpy.components.concat(), 1e-11);
        assert_close(synergy.contribution(), &numpy.contribution, 1e-13);
        assert_close(synergy.coefficient_min(), &numpy.coefficient_min, 1e-11);
        assert_close(synergy.coefficient_max(), &numpy.coefficient_max, 1e-11);
        let errors: Vec<f64> = numpy.postures.iter().map(|posture| synergy.error(posture)).collect();
        assert_close(&errors, &numpy.errors, 1e-11);
        let mean_error = numpy.errors.iter().sum::<f64>() / numpy.errors.len() as f64;
        assert_close(&[synergy.mean_error(&numpy.postures)], &[mean_error], 1e-12);
    }
}

#[test]
fn all_components_reconstruct_and_fewer_lose_the_rest() {
    let (joints, postures) = (joints(6), postures(50, 6));
    let full = Synergy::fit(&joints, &postures, 6).unwrap();
    assert!(full.mean_error(&postures) < 1e-14);
    assert!((full.contribution_sum() - 1.0).abs() < 1e-14);
    for k in 1..6 {
        let part = Synergy::fit(&joints, &postures, k).unwrap();
        // Mean squared error of the postures = sum of the variances left out (sample convention).
        let left_out: f64 = part.eigenvalues()[k..].iter().sum();
        let squared: f64 = postures.iter().map(|q| part.error(q).powi(2)).sum::<f64>() / 49.0;
        assert!((squared - left_out).abs() < 1e-13, "{k}: {squared} {left_out}");
        let shares = cumulative_explained_variance(&part, &postures).unwrap();
        assert!((shares[k - 1] - part.contribution_sum()).abs() < 1e-13);
    }
}

#[test]
fn the_sign_rule_holds_under_a_mirror_and_a_tie() {
    let postures = postures(80, 7);
    let mirrored: Vec<Vec<f64>> = postures.iter().map(|q| q.iter().map(|x| -x).collect()).collect();
    let (a, b) = (Synergy::fit(&joints(7), &postures, 7), Synergy::fit(&joints(7), &mirrored, 7));
    let (a, b) = (a.unwrap(), b.unwrap());
    assert_close(b.components(), a.components(), 1e-12);
    for i in 0..7 {
        let largest = a.component(i).iter().fold(0.0_f64, |best, x| if x.abs() > best.abs() { *x } else { best });
        assert!(largest > 0.0);
    }
    // Two joints in opposition are tied but for rounding: the lower index decides.
    for scale in [1.0, 0.1, 1.0 / 3.0] {
        let opposed: Vec<Vec<f64>> = (0..9).map(|i| f64::from(i) * scale).map(|x| vec![x, 1.0 - x]).collect();
        let synergy = Synergy::fit(&joints(2), &opposed, 1).unwrap();
        assert_close(synergy.component(0), &[0.5_f64.sqrt(), -(0.5_f64.sqrt())], 1e-12);
    }
}

#[test]
fn too_many_components_are_clamped_and_low_rank_is_completed() {
    let line = [[0.0, 0.0, 1.0], [1.0, 2.0, 1.0]];
    let synergy = Synergy::fit(&joints(3), &line, 10).unwrap();
    assert_eq!(synergy.n_components(), 3);
    assert!((synergy.contribution()[0] - 1.0).abs() < 1e-14 && synergy.contribution()[1] < 1e-14);
    assert_orthonormal(&synergy);
    let still = Synergy::fit(&joints(3), &[[0.5, 0.1, 0.2]; 4], 2).unwrap();
    assert_eq!((still.contribution(), still.total_variance()), (&[0.0, 0.0][..], 0.0));
    assert_orthonormal(&still);
}

#[test]
fn bad_input_is_refused() {
    let (joints, good) = (joints(3), postures(10, 3));
    let fit = |postures: &[Vec<f64>], k| Synergy::fit(&joints, postures, k).unwrap_err();
    assert!(matches!(fit(&good, 0), SynergyError::NoComponents));
    assert!(matches!(fit(&good[..1], 2), SynergyError::TooFewPostures { expected: 2, got: 1 }));
    let mut bad = good.clone();
    bad[4][1] = f64::NAN;
    assert!(matches!(fit(&bad, 2), SynergyError::NonFinitePosture { row: 4, column: 1, .. }));
    bad[4] = vec![1.0];
    assert!(matches!(fit(&bad, 2), SynergyError::PostureLength { row: 4, expected: 3, got: 1 }));
    bad[4] = vec![f64::MAX, -f64::MAX, 0.0];
    assert!(matches!(fit(&bad, 2), SynergyError::Decomposition { .. }));
    assert!(matches!(Synergy::fit(&[], &[vec![], vec![]], 1), Err(SynergyError::Joints { .. })));
}

#[test]
fn decode_clamps_to_the_limits() {
    let limits = [(0.0, 1.0), (f64::NEG_INFINITY, f64::INFINITY)];
    let joints: Vec<JointInfo> = limits
        .iter()
        .map(|&(lower, upper)| JointInfo { name: format!("{upper}"), unit: Unit::Radian, lower, upper })
        .collect();
    let synergy = Synergy::fit(&joints, &[[0.0, 0.0], [1.0, 1.0]], 1).unwrap();
    assert_close(&synergy.decode(&[50.0]), &[1.0, 0.5 + 50.0 * 0.5_f64.sqrt()], 1e-12);
    assert_close(&synergy.decode(&[-50.0]), &[0.0, 0.5 - 50.0 * 0.5_f64.sqrt()], 1e-12);
    assert!(synergy.decode_unclamped(&[50.0])[0] > 30.0);
}

#[test]
#[should_panic(expected = "one number for each joint")]
fn a_short_posture_panics() {
    Synergy::fit(&joints(3), &postures(10, 3), 2).unwrap().error_f32(&[0.0, 0.0]);
}

fn assert_orthonormal(synergy: &Synergy) {
    for i in 0..synergy.n_components() {
        for j in 0..=i {
            let product: f64 = synergy.component(i).iter().zip(synergy.component(j)).map(|(a, b)| a * b).sum();
            assert!((product - f64::from(u8::from(i == j))).abs() < 1e-12, "{i} {j}: {product}");
        }
    }
}

/// A space of any size, with a posture and coefficients for it.
fn space() -> impl Strategy<Value = (Synergy, Vec<f64>, Vec<f64>)> {
    (1usize..40, 1usize..20, 2usize..60).prop_flat_map(|(n, k, n_postures)| {
        let rows = prop::collection::vec(prop::collection::vec(-1.5..1.5f64, n), n_postures);
        (rows, prop::collection::vec(-2.0..2.0f64, n), prop::collection::vec(-1.0..1.0f64, k.min(n)))
            .prop_map(move |(rows, q, z)| (Synergy::fit(&joints(n), &rows, k).unwrap(), q, z))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn encoding_inverts_decoding((synergy, q, z) in space()) {
        assert_orthonormal(&synergy);
        assert_close(&synergy.encode(&synergy.decode_unclamped(&z)), &z, 1e-12);
        // The residual is orthogonal to the space, and shortest.
        let residual = synergy.residual(&q);
        for i in 0..synergy.n_components() {
            let product: f64 = synergy.component(i).iter().zip(&residual).map(|(a, b)| a * b).sum();
            prop_assert!(product.abs() < 1e-12);
        }
        let other: f64 = synergy.decode_unclamped(&z).iter().zip(&q).map(|(p, q)| (p - q).powi(2)).sum();
        prop_assert!(synergy.error(&q) <= other.sqrt() + 1e-12);
    }

    #[test]
    fn single_precision_error_agrees((synergy, q, z) in space()) {
        let near = synergy.decode_unclamped(&z);
        for posture in [q, near] {
            let single: Vec<f32> = posture.iter().map(|&x| x as f32).collect();
            let double: Vec<f64> = single.iter().map(|&x| f64::from(x)).collect();
            let (fast, exact) = (f64::from(synergy.error_f32(&single)), synergy.error(&double));
            let size = double.iter().map(|x| x * x).sum::<f64>().sqrt() + 1.0;
            prop_assert!((fast - exact).abs() < 2e-7 * size, "{fast} {exact}");
        }
    }
}
