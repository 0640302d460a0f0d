//! The replay's ring and the bytes of episodes.

use eigenhand_rl::{EpisodeData, EpisodeShape, Replay, RlError, rng};
use proptest::prelude::*;

use crate::{SHAPE, random_episode};

fn marked(mark: f32) -> EpisodeData {
    let mut episode = EpisodeData::zeros(SHAPE);
    episode.desired_goal[0] = mark;
    episode
}

/// Reads a record with nothing after it.
fn read(bytes: &[u8]) -> Result<EpisodeData, RlError> {
    let (episode, rest) = EpisodeData::read_prefix(bytes)?;
    assert!(rest.is_empty());
    Ok(episode)
}

proptest! {
    #[test]
    fn the_ring_keeps_the_newest(capacity in 1usize..8, n_pushed in 0usize..30) {
        let mut replay = Replay::new(capacity, SHAPE).unwrap();
        for mark in 0..n_pushed {
            replay.push(marked(mark as f32)).unwrap();
        }
        let mut kept: Vec<f32> = replay.episodes().iter().map(|e| e.desired_goal[0]).collect();
        kept.sort_by(f32::total_cmp);
        let expected: Vec<f32> = (n_pushed.saturating_sub(capacity)..n_pushed).map(|mark| mark as f32).collect();
        prop_assert_eq!(kept, expected);
        prop_assert_eq!(replay.len(), n_pushed.min(capacity));
    }

    #[test]
    fn bytes_round_trip(dims in [1usize..6, 0..5, 0..4, 0..4, 0..3], seed: u64) {
        let [n_steps, obs_dim, goal_dim, act_dim, fact_dim] = dims;
        let shape = EpisodeShape { n_steps, obs_dim, goal_dim, act_dim, fact_dim };
        let mut draws = rng::stream(seed, "episodes", 0);
        let (first, second) = (random_episode(shape, &mut draws), random_episode(shape, &mut draws));
        let record = first.to_bytes().unwrap();
        prop_assert_eq!(read(&record).unwrap(), first.clone());
        let log = [record.clone(), second.to_bytes().unwrap()].concat();
        let (found, rest) = EpisodeData::read_prefix(&log).unwrap();
        prop_assert_eq!(found, first);
        prop_assert_eq!(rest.len(), log.len() - record.len());
        prop_assert_eq!(read(rest).unwrap(), second);
    }

    #[test]
    fn a_changed_bit_is_noticed(position in 0.0f64..1.0, bit in 0u8..8) {
        let mut bytes = random_episode(SHAPE, &mut rng::stream(5, "episodes", 0)).to_bytes().unwrap();
        let index = (position * bytes.len() as f64) as usize;
        bytes[index] ^= 1 << bit;
        prop_assert!(read(&bytes).is_err(), "byte {index}");
    }

    #[test]
    fn arbitrary_bytes_do_not_panic(tail in prop::collection::vec(any::<u8>(), 0..100)) {
        prop_assert!(read(&tail).is_err());
        let mut bytes = EpisodeData::zeros(SHAPE).to_bytes().unwrap();
        bytes.truncate(12);
        bytes.extend(tail);
        prop_assert!(read(&bytes).is_err());
    }
}

#[test]
fn every_cut_is_reported_as_such() {
    let bytes = random_episode(SHAPE, &mut rng::stream(6, "episodes", 0)).to_bytes().unwrap();
    for len in 0..bytes.len() {
        match read(&bytes[..len]) {
            Err(RlError::EpisodeTruncated { got, expected }) => assert!(got == len && expected > len),
            other => panic!("cut after {len}: {other:?}"),
        }
    }
}

#[test]
fn wrong_episodes_are_refused_and_not_stored() {
    let mut replay = Replay::new(2, SHAPE).unwrap();
    let other = EpisodeData::zeros(EpisodeShape { n_steps: SHAPE.n_steps + 1, ..SHAPE });
    assert!(matches!(replay.push(other), Err(RlError::EpisodeShape { .. })));
    let mut short = EpisodeData::zeros(SHAPE);
    short.actions.pop();
    assert!(matches!(replay.push(short), Err(RlError::Length { name: "actions", .. })));
    let mut broken = EpisodeData::zeros(SHAPE);
    broken.facts[3] = f32::NAN;
    assert!(matches!(broken.to_bytes(), Err(RlError::NotFinite { name: "facts", index: 3, .. })));
    assert!(matches!(replay.push(broken), Err(RlError::NotFinite { name: "facts", index: 3, .. })));
    assert!(replay.is_empty());
    assert!(Replay::new(0, SHAPE).is_err());
}
