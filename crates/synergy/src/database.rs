//! The posture database of a run, in SQLite: the postures of its successes, and steps of its motions.
//!
//! People may open the file with other programs too. Table `posture` has one row for each successful training episode,
//! with the columns `id, episode, object, lambda, seed, step, goal_x, goal_y, goal_z, source` and then one column for
//! each joint, with the joint's name. Table `motion` has one row for each of some steps of a success without noise, with
//! the columns `id, episode, object, step, held`, one column for each joint, and a column `ctrl:NAME` for the command of
//! each actuator of the hand. SQLite ignores the case of column names; if a name is already taken, the column's name
//! gets the suffix `#2`, `#3` and so on. Tables `joint` and `actuator` list joints and actuators in order, with their
//! column (`column_name`), unit and limits.

use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use rusqlite::types::Value;
use rusqlite::{Connection, ErrorCode, OpenFlags, Row, TransactionBehavior, params_from_iter};

use crate::SynergyError;
use crate::joint::{check_coordinates, check_joints, check_posture, check_same_joints};
use crate::{JointInfo, Unit};

mod check;
mod columns;
mod connection;
mod motion;
mod record;
use columns::{RECORD_COLUMNS, column_names, quoted};
use connection::{cannot_write, connect, connect_immutable, log_of};
pub use motion::MotionRecord;
pub use record::{PostureRecord, Source};
use record::{from_row, to_values};

/// Marks an SQLite file as a posture database (`PRAGMA application_id`).
const APPLICATION_ID: i32 = 0x4547_4e48;

/// The version of the tables (`PRAGMA user_version`).
const SCHEMA_VERSION: i32 = 2;

/// The database of successful postures.
#[derive(Debug)]
pub struct PostureDatabase {
    path: PathBuf,
    connection: Connection,
    joints: Vec<JointInfo>,
    columns: Vec<String>,
    actuators: Vec<JointInfo>,
    actuator_columns: Vec<String>,
}

impl PostureDatabase {
    /// Creates the database at `path`, or opens an existing one. `actuators` are those of the hand, in the order of a
    /// command's numbers; without them, it can hold no commands.
    ///
    /// # Errors
    /// A bad list of joints or actuators; a file of another kind or version, or a damaged one; a database whose joints or
    /// actuators have other names or units. Limits may differ; the database keeps those of its creation.
    pub fn open(path: impl AsRef<Path>, joints: &[JointInfo], actuators: &[JointInfo]) -> Result<Self, SynergyError> {
        let path = path.as_ref();
        let inner = || {
            check_joints(joints)?;
            check_coordinates(actuators)?;
            let mut connection = connect(OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_CREATE, path)?;
            if is_blank(&connection)? {
                connection.pragma_update(None, "journal_mode", "WAL")?;
                create(&mut connection, joints, actuators)?;
            }
            let database = Self::read(path, connection)?;
            // A database that is complete has left this mode.
            database.connection.pragma_update(None, "journal_mode", "WAL")?;
            check_same_joints(joints, &database.joints)?;
            check_same_joints(actuators, &database.actuators)?;
            Ok(database)
        };
        inner().map_err(|error: SynergyError| recognise(error).in_file(path))
    }

    /// Opens the database at `path`, which must exist. It can also be read where nothing may be written.
    ///
    /// # Errors
    /// No file, a file of another kind or version, or a damaged one.
    pub fn open_existing(path: impl AsRef<Path>) -> Result<Self, SynergyError> {
        let path = path.as_ref();
        let inner = || {
            std::fs::metadata(path).map_err(SynergyError::io("open", path))?;
            let open = |connection: Connection| {
                if is_blank(&connection)? {
                    return Err(SynergyError::NotADatabase { reason: "the file is empty".to_owned() });
                }
                Self::read(path, connection)
            };
            match connect(OpenFlags::SQLITE_OPEN_READ_WRITE, path).and_then(open) {
                // SQLite needs files beside one in WAL mode, unless it is told that nothing changes it.
                Err(error) if cannot_write(&error) && !log_of(path).exists() => open(connect_immutable(path)?),
                outcome => outcome,
            }
        };
        inner().map_err(|error| match error {
            SynergyError::Io { .. } => error,
            error => recognise(error).in_file(path),
        })
    }

    fn read(path: &Path, connection: Connection) -> Result<Self, SynergyError> {
        check_kind(&connection)?;
        connection.pragma_update(None, "synchronous", "NORMAL")?;
        let (joints, columns) = read_joints(&connection, "joint")?;
        let (actuators, actuator_columns) = read_joints(&connection, "actuator")?;
        check_joints(&joints)?;
        check_coordinates(&actuators)?;
        Ok(PostureDatabase { path: path.to_owned(), connection, joints, columns, actuators, actuator_columns })
    }

    /// Returns the joints, in the order of a posture's numbers.
    pub fn joints(&self) -> &[JointInfo] {
        &self.joints
    }

    /// Returns the actuators, in the order of a command's numbers.
    pub fn actuators(&self) -> &[JointInfo] {
        &self.actuators
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits until the disk has everything that was appended or removed so far. Without it, the last records can be missing
    /// after a power cut; the database is sound in any case.
    ///
    /// # Errors
    /// [`SynergyError::Io`].
    pub fn sync(&self) -> Result<(), SynergyError> {
        // What the log does not hold, SQLite has synchronised with the database file before it dropped it from the log. The
        // database file is not opened here, because closing it would drop SQLite's locks.
        let log = log_of(&self.path);
        match File::open(&log).and_then(|file| file.sync_all()) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(SynergyError::io("write", &log)(error)),
            _ => Ok(()),
        }
    }

    /// Leaves WAL mode, so that the database is one file, which can be read where nothing may be written. While another program
    /// has it open, it stays in this mode.
    ///
    /// # Errors
    /// A failure of SQLite.
    pub fn finish(&self) -> Result<(), SynergyError> {
        self.run(|connection| match connection.pragma_update(None, "journal_mode", "DELETE") {
            Err(error) if error.sqlite_error_code() == Some(ErrorCode::DatabaseBusy) => Ok(()),
            outcome => Ok(outcome?),
        })
    }

    /// Appends either all of `records` or none.
    ///
    /// # Errors
    /// A record with a posture of the wrong length, or with a number that is not finite; a failure of SQLite.
    pub fn insert_all(&mut self, records: &[PostureRecord]) -> Result<(), SynergyError> {
        let n_joints = self.joints.len();
        let names: Vec<String> =
            RECORD_COLUMNS.iter().map(|name| (*name).to_owned()).chain(self.quoted_joints()).collect();
        self.append("posture", &names, records, |row, record| {
            check_posture(&record.posture, n_joints, row)?;
            to_values(record)
        })
    }

    /// Appends either all of `records` to a table or none. `values` checks a record, and returns its numbers and texts in
    /// the order of `names`.
    fn append<R>(
        &mut self,
        table: &str,
        names: &[String],
        records: &[R],
        values: impl Fn(usize, &R) -> Result<Vec<Value>, SynergyError>,
    ) -> Result<(), SynergyError> {
        let places = vec!["?"; names.len()].join(", ");
        let sql = format!("INSERT INTO {table} ({}) VALUES ({places})", names.join(", "));
        let connection = &mut self.connection;
        let mut inner = || {
            let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
            {
                let mut statement = transaction.prepare_cached(&sql)?;
                for (row, record) in records.iter().enumerate() {
                    statement.execute(params_from_iter(values(row, record)?))?;
                }
            }
            Ok(transaction.commit()?)
        };
        inner().map_err(|error: SynergyError| recognise(error).in_file(&self.path))
    }

    /// Returns the number of postures.
    ///
    /// # Errors
    /// A failure of SQLite.
    pub fn len(&self) -> Result<usize, SynergyError> {
        let count: i64 = self.run(|c| Ok(c.query_row("SELECT count(*) FROM posture", [], |row| row.get(0))?))?;
        Ok(count as usize)
    }

    /// Tells whether the database holds no posture.
    ///
    /// # Errors
    /// A failure of SQLite.
    pub fn is_empty(&self) -> Result<bool, SynergyError> {
        Ok(self.len()? == 0)
    }

    /// Returns all records, in the order of their insertion.
    ///
    /// # Errors
    /// A failure of SQLite, or a row that this crate did not write.
    pub fn load(&self) -> Result<Vec<PostureRecord>, SynergyError> {
        let names: Vec<String> =
            RECORD_COLUMNS.iter().map(|name| (*name).to_owned()).chain(self.quoted_joints()).collect();
        self.select(&names, |row| from_row(row, self.joints.len()))
    }

    /// Returns the postures that a policy reached, with or without noise, in the order of their insertion. Those of
    /// [scripts](Source::Script) are left out.
    ///
    /// # Errors
    /// As [`PostureDatabase::load`].
    pub fn policy_postures(&self) -> Result<Vec<Vec<f64>>, SynergyError> {
        let records = self.load()?.into_iter();
        Ok(records.filter(|record| record.source != Source::Script).map(|record| record.posture).collect())
    }

    /// Deletes the postures and motions of episode `episode` and of later ones, and returns the number of postures. A run that resumes from a
    /// checkpoint plays these episodes again.
    ///
    /// # Errors
    /// A failure of SQLite.
    pub fn truncate_from_episode(&mut self, episode: u64) -> Result<usize, SynergyError> {
        let Ok(episode) = i64::try_from(episode) else {
            return Ok(0);
        };
        self.run(|connection| {
            let transaction = connection.unchecked_transaction()?;
            transaction.execute("DELETE FROM motion WHERE episode >= ?", [episode])?;
            let deleted = transaction.execute("DELETE FROM posture WHERE episode >= ?", [episode])?;
            transaction.commit()?;
            Ok(deleted)
        })
    }

    /// Lists the quoted names of the joints' columns.
    fn quoted_joints(&self) -> impl Iterator<Item = String> {
        self.columns.iter().map(|column| quoted(column))
    }

    fn select<T>(
        &self,
        names: &[String],
        read: impl Fn(&Row<'_>) -> rusqlite::Result<T>,
    ) -> Result<Vec<T>, SynergyError> {
        // Without the table's name, SQLite reads a quoted name that is no column as a string.
        let names: Vec<String> = names.iter().map(|name| format!("posture.{name}")).collect();
        let sql = format!("SELECT {} FROM posture ORDER BY id", names.join(", "));
        self.run(|connection| {
            let mut statement = connection.prepare_cached(&sql)?;
            let rows = statement.query_map([], |row| read(row))?;
            Ok(rows.collect::<Result<Vec<T>, _>>()?)
        })
    }

    fn run<T>(&self, query: impl FnOnce(&Connection) -> Result<T, SynergyError>) -> Result<T, SynergyError> {
        query(&self.connection).map_err(|error| recognise(error).in_file(&self.path))
    }
}

/// Tells whether the file has no table and no mark yet.
fn is_blank(connection: &Connection) -> Result<bool, SynergyError> {
    Ok(connection.query_row("SELECT count(*) = 0 FROM sqlite_schema", [], |row| row.get(0))?
        && pragma(connection, "application_id")? == 0)
}

fn pragma(connection: &Connection, name: &str) -> Result<i32, SynergyError> {
    Ok(connection.pragma_query_value(None, name, |row| row.get(0))?)
}

fn check_kind(connection: &Connection) -> Result<(), SynergyError> {
    if pragma(connection, "application_id")? != APPLICATION_ID {
        return Err(SynergyError::NotADatabase { reason: "an SQLite file of another program".to_owned() });
    }
    let version = pragma(connection, "user_version")?;
    if version != SCHEMA_VERSION {
        return Err(SynergyError::Schema {
            what: "the posture database",
            expected: i64::from(SCHEMA_VERSION),
            got: i64::from(version),
        });
    }
    let verdict: String = connection.query_row("PRAGMA quick_check(1)", [], |row| row.get(0))?;
    if verdict == "ok" { Ok(()) } else { Err(SynergyError::Damaged { reason: verdict }) }
}

fn create(connection: &mut Connection, joints: &[JointInfo], actuators: &[JointInfo]) -> Result<(), SynergyError> {
    let (columns, actuator_columns) = column_names(joints, actuators);
    let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
    let reals = |columns: &[String]| -> String {
        columns.iter().map(|column| format!(", {} REAL NOT NULL", quoted(column))).collect()
    };
    let (postures, commands) = (reals(&columns), reals(&actuator_columns));
    transaction.execute_batch(&format!(
        "CREATE TABLE joint (position INTEGER PRIMARY KEY, name TEXT NOT NULL, column_name TEXT NOT NULL,
             unit TEXT NOT NULL, lower REAL NOT NULL, upper REAL NOT NULL);
         CREATE TABLE actuator (position INTEGER PRIMARY KEY, name TEXT NOT NULL, column_name TEXT NOT NULL,
             unit TEXT NOT NULL, lower REAL NOT NULL, upper REAL NOT NULL);
         CREATE TABLE posture (id INTEGER PRIMARY KEY AUTOINCREMENT, episode INTEGER NOT NULL, object TEXT NOT NULL,
             lambda REAL NOT NULL, seed INTEGER NOT NULL, step INTEGER NOT NULL, goal_x REAL NOT NULL,
             goal_y REAL NOT NULL, goal_z REAL NOT NULL, source TEXT NOT NULL{postures});
         CREATE TABLE motion (id INTEGER PRIMARY KEY AUTOINCREMENT, episode INTEGER NOT NULL, object TEXT NOT NULL,
             step INTEGER NOT NULL, held INTEGER NOT NULL{postures}{commands});
         CREATE INDEX posture_episode ON posture (episode);
         CREATE INDEX motion_episode ON motion (episode);"
    ))?;
    for (table, coordinates, columns) in [("joint", joints, &columns), ("actuator", actuators, &actuator_columns)] {
        for (position, (coordinate, column)) in coordinates.iter().zip(columns).enumerate() {
            let JointInfo { name, unit, lower, upper } = coordinate;
            transaction.execute(
                &format!("INSERT INTO {table} VALUES (?, ?, ?, ?, ?, ?)"),
                (position as i64, name, column, unit.symbol(), lower, upper),
            )?;
        }
    }
    transaction.pragma_update(None, "application_id", APPLICATION_ID)?;
    transaction.pragma_update(None, "user_version", SCHEMA_VERSION)?;
    Ok(transaction.commit()?)
}

/// Reads the table `joint` or `actuator`.
fn read_joints(connection: &Connection, table: &str) -> Result<(Vec<JointInfo>, Vec<String>), SynergyError> {
    let sql = format!("SELECT name, unit, lower, upper, column_name FROM {table} ORDER BY position");
    let mut statement = connection.prepare(&sql)?;
    let rows = statement.query_map([], |row| {
        let unit: String = row.get(1)?;
        Ok((row.get::<_, String>(0)?, unit, row.get::<_, f64>(2)?, row.get::<_, f64>(3)?, row.get::<_, String>(4)?))
    })?;
    let mut joints = Vec::new();
    let mut columns = Vec::new();
    for row in rows {
        let (name, symbol, lower, upper, column) = row?;
        let Some(unit) = Unit::from_symbol(&symbol) else {
            let message = format!("{table} {name:?} has the unit {symbol:?}; expected \"rad\" or \"m\"");
            return Err(SynergyError::Joints { message });
        };
        joints.push(JointInfo { name, unit, lower, upper });
        columns.push(column);
    }
    Ok((joints, columns))
}

/// Turns SQLite's errors about a file that is no database, or is damaged, into variants of their own.
fn recognise(error: SynergyError) -> SynergyError {
    let SynergyError::Sqlite(rusqlite::Error::SqliteFailure(code, _)) = &error else {
        return error;
    };
    let reason = error.to_string();
    match code.code {
        ErrorCode::NotADatabase => SynergyError::NotADatabase { reason },
        ErrorCode::DatabaseCorrupt => SynergyError::Damaged { reason },
        _ => error,
    }
}
