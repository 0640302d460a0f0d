//! `README.md` of a bundle: what each file is for, and how to use it in four environments.

use std::path::Path;

use crate::Bundle;

/// Returns the text for the files that a directory has. `example` is the name of a trajectory, if there is one.
pub fn text(bundle: &Bundle, directory: &Path, example: Option<&str>) -> String {
    let hand = &bundle.hand.manifest.name;
    let Some(file) = bundle.synergy else {
        return format!(
            "# {hand}\n\nA policy of the hand `{hand}`, exported by Eigenhand {}. The run has no synergy, because its policy \
             never succeeded often enough.\n\n{}{POLICY}",
            bundle.version,
            table(directory)
        );
    };
    let (k, n) = (file.synergy.n_components(), file.synergy.n_joints());
    let counted = |n: usize, what: &str| if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") };
    let recommended = file.recommended.as_ref().map_or(String::new(), |recommended| {
        let are = if recommended.components == 1 { "is" } else { "are" };
        format!(" {} of them {are} recommended: {}.", recommended.components, recommended.reason)
    });
    let introduction = format!(
        "# {hand}\n\n{} for the {} of the hand `{hand}`, and the policy that uses them; exported by Eigenhand {}.{recommended}\n\n",
        counted(k, "number"),
        counted(n, "actuator"),
        bundle.version
    );
    let grasp = file.grasps.iter().find(|grasp| grasp.numbers == k);
    let synergy = match grasp {
        Some(grasp) => SYNERGY.replace("OBJECT", &grasp.object),
        None => SYNERGY.replace(GRASP, "closed = synergy.z_high\n"),
    };
    let ros2 = example.map_or(String::new(), |name| ROS2.replace("OBJECT", name));
    introduction + &table(directory) + &synergy + &ros2 + MOTORS_TEXT + POLICY
}

/// Returns a row for each file that is there.
fn table(directory: &Path) -> String {
    let rows: String = FILES
        .iter()
        .filter(|(file, _, _)| directory.join(file).exists())
        .map(|(_, names, content)| format!("| {names} | {content} |\n"))
        .collect();
    format!("| file | content |\n|---|---|\n{rows}\n")
}

/// A file that shows whether a row belongs into the table, and the row.
const FILES: [(&str, &str, &str); 9] = [
    ("synergy", "`synergy/synergy.toml`", "the control synergy: mean, components, ranges, joint map, mean grasps"),
    (
        "synergy.npz",
        "`synergy/*.npy`, `synergy.npz`",
        "the same as arrays; `synergy.npz` is one archive, with the names of joints and actuators",
    ),
    ("synergy-postures", "`synergy-postures/`", "the synergy of the postures at the end of grasps"),
    ("motors.toml", "`motors.toml`", "from commands to your motors: fill it in"),
    ("ros2", "`ros2/`", "profiles for `grasp_synergy_adapter`, and a trajectory for each object"),
    ("policy.onnx", "`policy.onnx`", "the policy, for any ONNX runtime"),
    (
        "policy.toml",
        "`policy.safetensors`, `policy.toml`",
        "the same as tensors, and the names of all inputs and outputs",
    ),
    ("scenes", "`scenes/`", "the hand with each object, for MuJoCo"),
    // It is written last.
    ("policy.toml", "`manifest.json`", "size and SHA-256 of each file, but for `motors.toml`"),
];

/// The line of the example that needs a grasp.
const GRASP: &str = "opened, closed, held = (z for z, q in synergy.grasp(\"OBJECT\").values())\n";

const SYNERGY: &str = "
## The numbers

The commands are `u = mean + z components`, clamped to the actuators' ranges. Numbers that you leave out are 0.

**Python** (`pip install ./python` in Eigenhand's repository, or plain NumPy with `synergy.npz`):

```python
import eigenhand
synergy = eigenhand.Synergy.load(\".\")
opened, closed, held = (z for z, q in synergy.grasp(\"OBJECT\").values())
u = synergy.command(closed)               # commands of synergy.actuators
q = synergy.decode(closed)                # where synergy.joints then are, on average
z = synergy.encode(q)                     # the numbers of a measured posture

import numpy as np
s = np.load(\"synergy.npz\")
u = np.clip(s[\"mean\"] + closed @ s[\"components\"], s[\"actuator_low\"], s[\"actuator_high\"])
```

**C++**: `examples/cpp/control_loop.cpp` of the repository is a loop of 100 Hz on `synergy/synergy.toml`.

**Rust** (crate `eigenhand-synergy`):

```rust
let file = eigenhand_synergy::SynergyFile::read(\"synergy/synergy.toml\")?;
let motors = eigenhand_synergy::MotorMap::read(\"motors.toml\", &file.hand, file.synergy.joints())?;
let values = motors.values(&file.synergy.decode(&z));
```
";

const ROS2: &str = "
**ROS 2**, with a `joint_trajectory_controller` of the hand's joints:

```
ros2 run grasp_synergy_adapter grasp_synergy_adapter --ros-args --params-file ros2/grasp_profiles.yaml \\
    -r target/joint_trajectory:=/hand_controller/joint_trajectory \\
    -r target/follow_joint_trajectory:=/hand_controller/follow_joint_trajectory \\
    -r target/controller_state:=/hand_controller/controller_state
ros2 topic pub --once /hand_controller/joint_trajectory trajectory_msgs/msg/JointTrajectory \\
    \"$(cat ros2/trajectories/OBJECT.json)\"
```

A profile of an object goes from the open hand (0) to the hand that holds it (1); `number_1` moves the first number from its
least to its greatest value. Joint names are those of the model; change them to your controller's. A new export keeps a file
that you changed with the suffix `.edited`.
";

const MOTORS_TEXT: &str = "
## Motors

`motors.toml` maps each command to a motor: id, sign, scale, offset and limits. As exported, each motor takes its command.
Fill it in for your hand, and export again to have it checked: a new export keeps the file, and names what is wrong in it. In
Python, `eigenhand.Motors.load(\"motors.toml\", synergy)` turns commands into motor values and back.
";

const POLICY: &str = "
## The policy

`policy.onnx` takes `observation` and `goal` (batch x numbers, float32) and returns `action` in [-1, 1]; `policy.toml` names
every number, and gives the range onto which an action is mapped.

```python
import onnxruntime
session = onnxruntime.InferenceSession(\"policy.onnx\")
(action,) = session.run(None, {\"observation\": observation, \"goal\": goal})
```

```
python -m eigenhand play .                # episodes in MuJoCo
```

`gymnasium.make(\"eigenhand/Grasp-v0\", export=\".\")` is the task as an environment.
";
