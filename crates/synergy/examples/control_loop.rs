//! Opens and closes a hand with a few numbers, 100 times a second.
//!
//! ```text
//! cargo run --release -p eigenhand-synergy --example control_loop -- SYNERGY OBJECT
//! ```
//!
//! SYNERGY is a directory with `synergy.toml`, such as `synergies/shadow`. The numbers move from the open hand to the mean
//! grasp of the object. Replace `send` with what commands your motors. At the end, the numbers of a measured posture are
//! computed.

use std::error::Error;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

use eigenhand_synergy::{JointInfo, Moment, SynergyFile};

const PERIOD: Duration = Duration::from_millis(10);
/// Ticks of each part of the motion: a second to close, half a second to squeeze.
const CLOSE: u32 = 100;
const SQUEEZE: u32 = 50;

/// A part of the motion: from one named moment of a grasp to another.
struct Part<'a> {
    ticks: u32,
    start: (&'a str, &'a Moment),
    end: (&'a str, &'a Moment),
}

/// Commands the hand: each number is a joint position in rad or m, for the actuator of that name.
fn send(_actuators: &[JointInfo], _command: &[f64]) {}

fn report(moment: &str, kind: &str, axes: &[JointInfo], values: &[f64]) {
    for (axis, value) in axes.iter().zip(values) {
        println!("{moment} {kind} {} {value:?}", axis.name);
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [directory, object] = arguments.as_slice() else { return Err("usage: control_loop SYNERGY OBJECT".into()) };
    let file = SynergyFile::read(Path::new(directory).join("synergy.toml"))?;
    let synergy = &file.synergy;
    let joint_map = file.joint_map.as_ref().ok_or("this synergy has no map to joint positions")?;
    let grasp = file.grasps.iter().find(|grasp| grasp.object == *object && grasp.numbers == synergy.n_components());
    let grasp = grasp.ok_or_else(|| format!("there is no grasp of {object}"))?;

    let parts = [
        Part { ticks: CLOSE, start: ("open", &grasp.open), end: ("closed", &grasp.closed) },
        Part { ticks: SQUEEZE, start: ("closed", &grasp.closed), end: ("held", &grasp.held) },
    ];
    let mut next_tick = Instant::now();
    for Part { ticks, start, end } in parts {
        for tick in 0..=ticks {
            let share = f64::from(tick) / f64::from(ticks);
            let z: Vec<f64> = start.1.z.iter().zip(&end.1.z).map(|(a, b)| a + share * (b - a)).collect();
            // In a space of commands, the axes of the synergy are the actuators.
            let command = synergy.decode(&z);
            let posture = joint_map.decode(&z);
            send(synergy.joints(), &command);
            if tick == 0 || tick == ticks {
                let moment = if tick == 0 { start.0 } else { end.0 };
                report(moment, "command", synergy.joints(), &command);
                report(moment, "joint", &joint_map.joints, &posture);
            }
            next_tick += PERIOD;
            sleep(next_tick.saturating_duration_since(Instant::now()));
        }
    }

    // The way back: the numbers whose joint positions are nearest to a measured posture. The arm's joints do not count.
    for (i, number) in joint_map.encode(&grasp.held.q)?.iter().enumerate() {
        println!("measured number {} {number:?}", i + 1);
    }
    Ok(())
}
