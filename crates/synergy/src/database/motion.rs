//! The motions of successful episodes: commands and postures at some of their steps.

use rusqlite::Row;
use rusqlite::types::Value;

use super::PostureDatabase;
use super::columns::{MOTION_COLUMNS, quoted};
use crate::SynergyError;
use crate::joint::check_posture;

/// One step of a successful episode in which no noise was added.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionRecord {
    /// The number of the training episode.
    pub episode: u64,
    /// The name of the object that was grasped.
    pub object: String,
    /// The control step, from 0.
    pub step: u32,
    /// Whether the hand holds the object from this step to the end.
    pub held: bool,
    /// The posture after the step, in the order of the database's joints.
    pub posture: Vec<f64>,
    /// The commands of the step, in the order of the database's actuators, before they are clamped to their ranges.
    pub command: Vec<f64>,
}

impl PostureDatabase {
    /// Appends either all of these steps or none.
    ///
    /// # Errors
    /// A record with a posture or a command of the wrong length, or with a number that is not finite; a failure of
    /// SQLite.
    pub fn insert_motions(&mut self, records: &[MotionRecord]) -> Result<(), SynergyError> {
        let names: Vec<String> = self.motion_columns().collect();
        let (n_joints, n_actuators) = (self.joints.len(), self.actuators.len());
        self.append("motion", &names, records, |row, record| {
            check_posture(&record.posture, n_joints, row)?;
            check_posture(&record.command, n_actuators, row)?;
            to_values(record)
        })
    }

    /// Returns all steps of all motions, in the order of their insertion.
    ///
    /// # Errors
    /// A failure of SQLite, or a row that this crate did not write.
    pub fn motions(&self) -> Result<Vec<MotionRecord>, SynergyError> {
        let names: Vec<String> = self.motion_columns().map(|name| format!("motion.{name}")).collect();
        let sql = format!("SELECT {} FROM motion ORDER BY id", names.join(", "));
        let (n_joints, n_actuators) = (self.joints.len(), self.actuators.len());
        self.run(|connection| {
            let mut statement = connection.prepare_cached(&sql)?;
            let rows = statement.query_map([], |row| from_row(row, n_joints, n_actuators))?;
            Ok(rows.collect::<Result<Vec<_>, _>>()?)
        })
    }

    fn motion_columns(&self) -> impl Iterator<Item = String> {
        let own = MOTION_COLUMNS.iter().map(|name| (*name).to_owned());
        own.chain(self.columns.iter().chain(&self.actuator_columns).map(|column| quoted(column)))
    }
}

/// (a record) => its values, in the order of `MOTION_COLUMNS`, the joints and the actuators
fn to_values(record: &MotionRecord) -> Result<Vec<Value>, SynergyError> {
    let MotionRecord { episode, object, step, held, posture, command } = record;
    let mut values = vec![
        Value::Integer(super::record::episode_number(*episode)?),
        Value::Text(object.clone()),
        Value::Integer(i64::from(*step)),
        Value::Integer(i64::from(*held)),
    ];
    values.extend(posture.iter().chain(command).map(|value| Value::Real(*value)));
    Ok(values)
}

fn from_row(row: &Row<'_>, n_joints: usize, n_actuators: usize) -> rusqlite::Result<MotionRecord> {
    let first = MOTION_COLUMNS.len();
    let numbers = |from: usize, n: usize| (from..from + n).map(|i| row.get(i)).collect::<Result<Vec<f64>, _>>();
    Ok(MotionRecord {
        episode: row.get::<_, i64>(0)?.cast_unsigned(),
        object: row.get(1)?,
        step: row.get(2)?,
        held: row.get(3)?,
        posture: numbers(first, n_joints)?,
        command: numbers(first + n_joints, n_actuators)?,
    })
}
