//! Whether a database still holds what was written to it.

use rusqlite::types::ValueRef;
use sha2::{Digest, Sha256};

use super::PostureDatabase;
use crate::SynergyError;

/// Tables whose rows are digested.
const TABLES: [&str; 2] = ["posture", "motion"];

impl PostureDatabase {
    /// Checks the file's pages and indices (`PRAGMA integrity_check`).
    ///
    /// # Errors
    /// [`SynergyError::Damaged`] with SQLite's first finding.
    pub fn check_integrity(&self) -> Result<(), SynergyError> {
        self.run(|connection| {
            let finding: String = connection.query_row("PRAGMA integrity_check(1)", [], |row| row.get(0))?;
            if finding == "ok" { Ok(()) } else { Err(SynergyError::Damaged { reason: finding }) }
        })
    }

    /// Returns the number of postures of episodes before `episode`.
    ///
    /// # Errors
    /// A failure of SQLite.
    pub fn len_before(&self, episode: u64) -> Result<u64, SynergyError> {
        let before = i64::try_from(episode).unwrap_or(i64::MAX);
        self.run(|connection| {
            let sql = "SELECT count(*) FROM posture WHERE episode < ?";
            Ok(connection.query_row(sql, [before], |row| row.get::<_, i64>(0))? as u64)
        })
    }

    /// Returns the SHA-256 of all rows of episodes before `episode` in their order, without their numbers, in hexadecimal.
    ///
    /// # Errors
    /// A failure of SQLite.
    pub fn digest_before(&self, episode: u64) -> Result<String, SynergyError> {
        let before = i64::try_from(episode).unwrap_or(i64::MAX);
        self.run(|connection| {
            let mut digest = Sha256::new();
            for table in TABLES {
                let mut statement =
                    connection.prepare_cached(&format!("SELECT * FROM {table} WHERE episode < ? ORDER BY id"))?;
                let n = statement.column_count();
                let mut rows = statement.query([before])?;
                while let Some(row) = rows.next()? {
                    // The first column is the row's number, which depends on rows that were there before.
                    for column in 1..n {
                        // A mark for the type and the length keep the values apart.
                        match row.get_ref(column)? {
                            ValueRef::Null => digest.update(b"n"),
                            ValueRef::Integer(value) => digest.update([b"i", &value.to_le_bytes()[..]].concat()),
                            ValueRef::Real(value) => digest.update([b"r", &value.to_le_bytes()[..]].concat()),
                            ValueRef::Text(bytes) | ValueRef::Blob(bytes) => {
                                digest.update([b"b", &(bytes.len() as u64).to_le_bytes()[..], bytes].concat());
                            }
                        }
                    }
                }
            }
            Ok(digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
        })
    }
}
