//! The name of the column of each joint.

use std::collections::HashSet;

use crate::JointInfo;

/// The columns of a record other than its posture, in the order in which they are written and read.
pub(super) const RECORD_COLUMNS: [&str; 8] =
    ["episode", "object", "lambda", "seed", "step", "goal_x", "goal_y", "goal_z"];

/// The table's key. No joint may take its name.
const KEY_COLUMN: &str = "id";

/// Returns a column name for each joint: the joint's own name, unless it is taken or holds a NUL.
pub(super) fn column_names(joints: &[JointInfo]) -> Vec<String> {
    // SQLite folds the case of ASCII letters only.
    let mut taken: HashSet<String> =
        RECORD_COLUMNS.iter().chain([&KEY_COLUMN]).map(|name| (*name).to_owned()).collect();
    let mut columns = Vec::with_capacity(joints.len());
    for joint in joints {
        let name = joint.name.replace('\0', "\u{fffd}");
        let mut column = name.clone();
        let mut suffix = 2;
        while !taken.insert(column.to_ascii_lowercase()) {
            column = format!("{name}#{suffix}");
            suffix += 1;
        }
        columns.push(column);
    }
    columns
}

/// (a name without NUL) => the name as an SQL identifier
pub(super) fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Unit;

    #[test]
    fn taken_names_get_a_suffix() {
        let joints: Vec<JointInfo> = ["J1", "j1", "Episode", "j1#2", "é", "É", "id", "a\0b"]
            .map(|name| JointInfo { name: name.to_owned(), unit: Unit::Radian, lower: 0.0, upper: 1.0 })
            .to_vec();
        let expected = ["J1", "j1#2", "Episode#2", "j1#2#2", "é", "É", "id#2", "a\u{fffd}b"];
        assert_eq!(column_names(&joints), expected);
        assert_eq!(quoted(r#"a"b"#), r#""a""b""#);
    }
}
