"""Drives the simulated hand through a grasp with nothing but an export: a few numbers in, a lift out.

    python drive_synergy.py EXPORT [--object NAME] [--numbers K] [--render FILE.png]

EXPORT is a run directory, or what `cargo xtask export` wrote. No policy runs. `synergy/synergy.toml` says what the numbers
command, and its [[grasps]] hold the numbers of a mean grasp of each object: open, closed and held. The hand
starts more or less closed. The script opens it, moves the arm down, moves the numbers from open to closed, and moves the
arm up. It ends with a status of 1 if the object is not lifted by at least 5 cm.
"""

import argparse
import json
import pathlib
import sys
from types import SimpleNamespace

import mujoco
import numpy as np

from run_policy import NEWER_FEATURES, render

try:
    import tomllib
except ModuleNotFoundError:  # Python before 3.11: pip install tomli
    import tomli as tomllib

# Seconds of each part of the grasp.
OPEN, DOWN, CLOSE, SQUEEZE, UP, HOLD = 0.6, 0.8, 0.8, 0.3, 1.0, 0.5
LEAST_LIFT = 0.05
# The policy closes the hand while it comes down. The script brings the hand down first, and lower by so many metres.
LOWER = 0.04


def objects(config):
    """The objects of which there are grasps."""
    return list(dict.fromkeys(grasp["object"] for grasp in config["grasps"]))


class Synergy:
    """A few numbers z in, a command for each of the hand's actuators out."""

    def __init__(self, path, numbers):
        self.config = tomllib.loads(path.read_text())
        assert self.config["space"] == "commands", f"{path} holds no control synergy"
        self.mean = np.array(self.config["mean"])
        self.components = np.array(self.config["components"])[:numbers]
        self.actuators = [actuator["name"] for actuator in self.config["actuators"]]
        self.low = np.array([actuator["lower"] for actuator in self.config["actuators"]])
        self.high = np.array([actuator["upper"] for actuator in self.config["actuators"]])
        self.joints = [joint["name"] for joint in self.config["joint_map"]["joints"]]

    def command(self, z):
        return np.clip(self.mean + z @ self.components, self.low, self.high)

    def grasp(self, name):
        """The numbers and the measured joint positions of a grasp's moments."""
        k = len(self.components)
        # In the order of their numbers: the first that has enough has the fewest.
        grasps = [grasp for grasp in self.config["grasps"] if grasp["object"] == name and grasp["numbers"] >= k]
        assert grasps, f"there is no grasp of {name!r}; there are {', '.join(objects(self.config))}"
        return {m: (np.array(grasps[0][m]["z"])[:k], np.array(grasps[0][m]["q"])) for m in ("open", "closed", "held")}


def drive(export, name, numbers, picture):
    synergy = Synergy(export / "synergy" / "synergy.toml", numbers)
    policy = tomllib.loads((export / "policy.toml").read_text())
    reference = next(r for r in json.loads((export / "scenes" / "reference.json").read_text()) if r["object"] == name)
    model = mujoco.MjModel.from_xml_path(str(export / "scenes" / f"{name}.xml"))
    for feature in NEWER_FEATURES:
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, feature, 0))
    data = mujoco.MjData(model)
    data.qpos[:] = reference["qpos"]
    data.ctrl[:] = reference["ctrl"]

    def index(kind, name):
        found = mujoco.mj_name2id(model, kind, name)
        assert found >= 0, f"the scene has no {name}"
        return found

    actuators = [index(mujoco.mjtObj.mjOBJ_ACTUATOR, actuator) for actuator in synergy.actuators]
    # The only actuator that the synergy does not command is the slide, which stands for the arm.
    (arm,) = set(range(model.nu)) - set(actuators)
    arm_joint = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, arm)
    place = model.jnt_qposadr[index(mujoco.mjtObj.mjOBJ_JOINT, policy["scene"]["object_joint"])] + 2
    grasp = synergy.grasp(name)
    height = {moment: q[synergy.joints.index(arm_joint)] for moment, (_, q) in grasp.items()}
    height["closed"] -= LOWER
    numbers = {moment: z for moment, (z, _) in grasp.items()}
    start = data.ctrl[arm]

    def move(seconds, numbers_from, numbers_to, arm_from, arm_to):
        steps = round(seconds / policy["control_period_s"])
        for step in range(1, steps + 1):
            share = step / steps
            data.ctrl[actuators] = synergy.command(numbers_from + share * (numbers_to - numbers_from))
            data.ctrl[arm] = arm_from + share * (arm_to - arm_from)
            for _ in range(policy["substeps"]):
                mujoco.mj_step(model, data)

    mujoco.mj_forward(model, data)
    low = data.qpos[place]
    opened, closed, held = numbers["open"], numbers["closed"], numbers["held"]
    move(OPEN, opened, opened, start, start)
    move(DOWN, opened, opened, start, height["closed"])
    move(CLOSE, opened, closed, height["closed"], height["closed"])
    move(SQUEEZE, closed, held, height["closed"], height["closed"])
    move(UP, held, held, height["closed"], height["held"])
    move(HOLD, held, held, height["held"], height["held"])
    if picture:
        render(SimpleNamespace(model=model, data=data), picture)
    return data.qpos[place] - low


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("export", type=pathlib.Path)
    parser.add_argument("--object", help="object to grasp; all of them without this option")
    parser.add_argument("--numbers", type=int, default=5, help="how many numbers command the hand")
    parser.add_argument("--render", metavar="FILE.png", help="writes a picture of the last grasp")
    arguments = parser.parse_args()
    config = tomllib.loads((arguments.export / "synergy" / "synergy.toml").read_text())
    names = [arguments.object] if arguments.object else objects(config)
    lifts = []
    for name in names:
        lifts.append(drive(arguments.export, name, arguments.numbers, arguments.render))
        print(f"{name}: lifted by {100 * lifts[-1]:.1f} cm")
    lifted = sum(lift >= LEAST_LIFT for lift in lifts)
    print(f"numbers: {arguments.numbers}; {lifted} of {len(lifts)} objects lifted")
    sys.exit(0 if lifted == len(lifts) else 1)


if __name__ == "__main__":
    main()
