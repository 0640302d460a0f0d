//! A small hand in a temporary directory: a palm, two fingers of two links, one coupled.

use std::path::{Path, PathBuf};

use eigenhand_hands::{Hand, HandError};
use tempfile::TempDir;

pub const MANIFEST: &str = r#"schema = 1
name = "pincer"
model = "pincer.xml"
palm = "base"
fingertips = ["left_tip", "right_far"]

[mount]
position = [0.0, 0.0, 0.2]

[open_posture]
left_near_joint = 0.5
"#;

pub const MODEL: &str = r#"<mujoco>
  <compiler meshdir="meshes"/>
  <default>
    <joint limited="true" range="-90 90"/>
    <position ctrllimited="true" ctrlrange="-1 1" kp="2"/>
    <default class="far"><joint range="0 60"/></default>
  </default>
  <asset><mesh name="pad" file="pad.obj"/></asset>
  <worldbody>
    <body name="base">
      <body name="left_near">
        <body name="left_far" childclass="far">
          <joint name="left_far_joint" axis="0 1 0"/>
          <geom size="0.01"/>
          <site name="left_tip"/>
        </body>
        <joint name="left_near_joint" axis="0 1 0"/>
        <geom size="0.01"/>
      </body>
      <body name="right_near">
        <joint name="right_near_joint" type="slide" axis="0 1 0" range="0 0.05"/>
        <geom size="0.01"/>
        <body name="right_far">
          <joint name="right_far_joint" class="far" axis="0 1 0" range="10 20" ref="0"/>
          <geom type="mesh" mesh="pad"/>
        </body>
      </body>
    </body>
  </worldbody>
  <include file="drives.xml"/>
  <equality>
    <joint joint1="left_far_joint" joint2="left_near_joint" polycoef="0.1 2"/>
    <joint joint1="right_far_joint" joint2="right_near_joint" active="false"/>
  </equality>
</mujoco>
"#;

pub const DRIVES: &str = r#"<mujocoinclude>
  <tendon>
    <fixed name="both"><joint joint="right_near_joint" coef="3"/><joint joint="right_far_joint" coef="-0.5"/></fixed>
  </tendon>
  <actuator>
    <position name="left_drive" joint="left_near_joint" gear="2"/>
    <position name="right_drive" tendon="both"/>
  </actuator>
</mujocoinclude>
"#;

pub struct Fixture {
    _root: TempDir,
    pub directory: PathBuf,
}

impl Fixture {
    pub fn new() -> Self {
        let root = TempDir::new().unwrap();
        let directory = root.path().join("pincer");
        write(&directory);
        Self { _root: root, directory }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.directory.join(name)
    }

    /// Replaces `from`, which must be there, in the file `name`.
    pub fn edit(&self, name: &str, from: &str, to: &str) {
        let text = std::fs::read_to_string(self.path(name)).unwrap();
        assert!(text.contains(from), "{name} has no {from}");
        std::fs::write(self.path(name), text.replace(from, to)).unwrap();
    }

    pub fn load(&self) -> Result<Hand, HandError> {
        Hand::load(&self.directory)
    }

    /// Loads the hand, which must be broken, and returns the message with the directory shortened to `DIR`.
    pub fn message(&self) -> String {
        let error = self.load().expect_err("the hand is broken");
        error.to_string().replace(&self.directory.display().to_string(), "DIR")
    }
}

pub fn write(directory: &Path) {
    std::fs::create_dir_all(directory.join("meshes")).unwrap();
    std::fs::write(directory.join("hand.toml"), MANIFEST).unwrap();
    std::fs::write(directory.join("pincer.xml"), MODEL).unwrap();
    std::fs::write(directory.join("drives.xml"), DRIVES).unwrap();
    std::fs::write(directory.join("meshes/pad.obj"), "v 0 0 0\n").unwrap();
}
