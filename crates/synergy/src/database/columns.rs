//! The name of the column of each joint.

use std::collections::HashSet;

use crate::JointInfo;

/// The columns of a record other than its posture, in the order in which they are written and read.
pub(super) const RECORD_COLUMNS: [&str; 9] =
    ["episode", "object", "lambda", "seed", "step", "goal_x", "goal_y", "goal_z", "source"];

/// The columns of a step of a motion other than its posture and its command, in the same order.
pub(super) const MOTION_COLUMNS: [&str; 4] = ["episode", "object", "step", "held"];

/// The name of a command's column begins with this; the actuator's name follows.
const COMMAND_PREFIX: &str = "ctrl:";

/// The table's key. No joint may take its name.
const KEY_COLUMN: &str = "id";

/// Returns a column name for each joint, and one for each actuator: the joint's own name, or `ctrl:` and the actuator's
/// name, unless it is taken or holds a NUL.
pub(super) fn column_names(joints: &[JointInfo], actuators: &[JointInfo]) -> (Vec<String>, Vec<String>) {
    // SQLite folds the case of ASCII letters only.
    let reserved = RECORD_COLUMNS.iter().chain(&MOTION_COLUMNS).chain([&KEY_COLUMN]);
    let mut taken: HashSet<String> = reserved.map(|name| (*name).to_owned()).collect();
    let mut free = |name: String| {
        let name = name.replace('\0', "\u{fffd}");
        let mut column = name.clone();
        let mut suffix = 2;
        while !taken.insert(column.to_ascii_lowercase()) {
            column = format!("{name}#{suffix}");
            suffix += 1;
        }
        column
    };
    let joints = joints.iter().map(|joint| free(joint.name.clone())).collect();
    let actuators = actuators.iter().map(|actuator| free(format!("{COMMAND_PREFIX}{}", actuator.name))).collect();
    (joints, actuators)
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
        let (columns, commands) = column_names(&joints, &joints[..2]);
        assert_eq!(columns, expected);
        assert_eq!(commands, ["ctrl:J1", "ctrl:j1#2"]);
        assert_eq!(quoted(r#"a"b"#), r#""a""b""#);
    }
}
