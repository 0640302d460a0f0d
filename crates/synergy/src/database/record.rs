//! One row of the database.

use rusqlite::Row;
use rusqlite::types::{FromSql, FromSqlError, FromSqlResult, ToSql, ToSqlOutput, Value, ValueRef};

use super::columns::RECORD_COLUMNS;
use crate::SynergyError;

/// What chose the actions of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Source {
    /// The policy alone.
    Policy,
    /// The policy with noise, or with fewer numbers than it has.
    Noise,
    /// A scripted grasp or random actions. Its posture is no part of a policy's synergy.
    Script,
}

impl Source {
    /// Returns the word in the database.
    pub fn name(self) -> &'static str {
        match self {
            Source::Policy => "policy",
            Source::Noise => "noise",
            Source::Script => "script",
        }
    }
}

impl ToSql for Source {
    fn to_sql(&self) -> rusqlite::Result<ToSqlOutput<'_>> {
        Ok(self.name().into())
    }
}

impl FromSql for Source {
    fn column_result(value: ValueRef<'_>) -> FromSqlResult<Self> {
        let word = value.as_str()?;
        let sources = [Source::Policy, Source::Noise, Source::Script];
        sources.into_iter().find(|source| source.name() == word).ok_or(FromSqlError::InvalidType)
    }
}

/// One successful training episode.
#[derive(Debug, Clone, PartialEq)]
pub struct PostureRecord {
    /// The posture that succeeded, in the order of the database's joints.
    pub posture: Vec<f64>,
    /// The name of the object that was grasped.
    pub object: String,
    /// The number of the training episode.
    pub episode: u64,
    /// The coefficient `lambda` of the approximation error during the episode.
    pub lambda: f64,
    /// The run's seed. SQLite shows a seed above 2^63 - 1 as a negative number (its two's complement).
    pub seed: u64,
    /// The desired position of the object's centre, in metres.
    pub goal: [f64; 3],
    /// The control step of the episode at which the posture was taken.
    pub step: u32,
    /// What chose the episode's actions.
    pub source: Source,
}

/// (a record) => its values, in the order of `RECORD_COLUMNS` and then the joints
pub(super) fn to_values(record: &PostureRecord) -> Result<Vec<Value>, SynergyError> {
    let PostureRecord { posture, object, episode, lambda, seed, goal, step, source } = record;
    for (name, value) in [("lambda", lambda), ("goal_x", &goal[0]), ("goal_y", &goal[1]), ("goal_z", &goal[2])] {
        if !value.is_finite() {
            return Err(SynergyError::invalid(name, "a finite number", value));
        }
    }
    let episode = episode_number(*episode)?;
    let mut values = vec![
        Value::Integer(episode),
        Value::Text(object.clone()),
        Value::Real(*lambda),
        Value::Integer(seed.cast_signed()),
        Value::Integer(i64::from(*step)),
    ];
    values.extend(goal.iter().map(|value| Value::Real(*value)));
    values.push(Value::Text(source.name().to_owned()));
    values.extend(posture.iter().map(|value| Value::Real(*value)));
    Ok(values)
}

/// (number of an episode) => SQLite's integer
pub(super) fn episode_number(episode: u64) -> Result<i64, SynergyError> {
    i64::try_from(episode).map_err(|_| SynergyError::invalid("episode", "at most 2^63 - 1", episode))
}

pub(super) fn from_row(row: &Row<'_>, n_joints: usize) -> rusqlite::Result<PostureRecord> {
    let first = RECORD_COLUMNS.len();
    Ok(PostureRecord {
        episode: row.get::<_, i64>(0)?.cast_unsigned(),
        object: row.get(1)?,
        lambda: row.get(2)?,
        seed: row.get::<_, i64>(3)?.cast_unsigned(),
        step: row.get(4)?,
        goal: [row.get(5)?, row.get(6)?, row.get(7)?],
        source: row.get(8)?,
        posture: (first..first + n_joints).map(|i| row.get(i)).collect::<Result<_, _>>()?,
    })
}
