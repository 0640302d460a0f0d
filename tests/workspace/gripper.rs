//! A small hand and small settings, for the tests here and for those of the command line.

/// The manifest of a gripper.
pub const GRIPPER_MANIFEST: &str = r#"schema = 1
name = "gripper"
model = "gripper.xml"
palm = "bridge"
fingertips = ["left", "right"]

[mount]
position = [0.0, 0.0, 0.12]

[slide]
range = [-0.045, 0.12]
"#;

/// Two pads that close on the object between them; the right pad follows the left one. Tests with this gripper take a
/// fraction of the time that a hand with many joints needs.
pub const GRIPPER_MODEL: &str = r#"<mujoco model="gripper">
  <default>
    <joint type="slide" limited="true" range="0 0.05" damping="10" armature="0.01"/>
    <geom contype="1" conaffinity="0" friction="2 0.05 0.01"/>
  </default>
  <worldbody>
    <body name="bridge">
      <geom type="box" size="0.02 0.07 0.01" mass="0.3"/>
      <body name="left" pos="0 0.06 -0.04">
        <joint name="left_joint" axis="0 -1 0"/>
        <geom type="box" size="0.02 0.008 0.03" mass="0.05"/>
      </body>
      <body name="right" pos="0 -0.06 -0.04">
        <joint name="right_joint" axis="0 1 0"/>
        <geom type="box" size="0.02 0.008 0.03" mass="0.05"/>
      </body>
      <!-- extra bodies -->
    </body>
  </worldbody>
  <equality>
    <joint name="together" joint1="right_joint" joint2="left_joint" polycoef="0 1 0 0 0"/>
  </equality>
  <actuator>
    <position name="close" joint="left_joint" kp="400" ctrllimited="true" ctrlrange="0 0.05"/>
    <!-- extra actuators -->
  </actuator>
</mujoco>
"#;

/// Settings of a run that takes a second or two. A test adds its own settings after them.
pub const TINY: [&str; 44] = [
    "hand=gripper",
    "episodes=24",
    "objects=[\"cube\"]",
    "workers=1",
    "lambda=1",
    "training.episodes_per_cycle=2",
    "training.warmup_episodes=16",
    "training.least_held_steps=0.0",
    "training.updates_per_episode=2.5",
    "training.slide_hold=1",
    "training.decay_start=0.6",
    "training.final_learning_rate=0.2",
    "training.checkpoint_every=8",
    "training.replay_episodes=20",
    "evaluation.every=8",
    "evaluation.episodes=4",
    "evaluation.final_episodes=6",
    "evaluation.selection_episodes=8",
    "synergy.components=2",
    "synergy.start_after=2",
    "synergy.window=4",
    "synergy.penalty=literal",
    "synergy.motions=2",
    "synergy.settle=0.5",
    "task.steps=30",
    "task.observe_fingertips=false",
    "task.final_steps=1",
    "task.goal_height=[0.02, 0.05]",
    "task.object_range=0.005",
    "task.orientation=yaw",
    "task.settle_time=0.1",
    "physics.timestep=0.004",
    "physics.substeps=10",
    "physics.cone=elliptic",
    "physics.impratio=10",
    "physics.noslip_iterations=0",
    "physics.solver_iterations=20",
    "physics.self_collision=false",
    "learner.hidden=[16, 16]",
    "learner.batch_size=32",
    "exploration.noise_free_share=0.5",
    "exploration.noise_sigma=0.1",
    "exploration.random_probability=0.1",
    "exploration.random_hold_steps=5",
];

/// Enough episodes and updates for a policy that succeeds by itself; a scripted success is no part of a synergy.
pub const LONGER: [&str; 3] = ["episodes=120", "training.updates_per_episode=20", "exploration.random_hold_steps=6"];

/// After [`LONGER`]: long enough for a policy that begins anew to succeed with few numbers too.
pub const ANEW: [&str; 4] =
    ["episodes=240", "training.replay_episodes=400", "learner.hidden=[32, 32]", "learner.gamma=0.95"];

/// A vane, and the actuator that turns it: with it, one component cannot give all commands of the gripper.
pub const VANE: &str = r#"<body name="vane" pos="0 0 0.05">
        <joint name="vane_joint" type="hinge" axis="0 0 1" range="-60 60" damping="0.1"/>
        <geom type="box" size="0.02 0.01 0.01" mass="0.05"/>
      </body>"#;
/// See [`VANE`].
pub const TURN: &str = r#"<position name="turn" joint="vane_joint" kp="1" ctrllimited="true" ctrlrange="-1 1"/>"#;
