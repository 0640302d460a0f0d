"""Drives the simulated hand through a grasp with nothing but an export: a few numbers in, a lift out.

    python drive_synergy.py EXPORT [--object NAME] [--numbers K] [--render FILE.png]

EXPORT is a run directory, or what `cargo xtask export` wrote. No policy runs. `synergy/synergy.toml` says what the numbers
command, and its [[grasps]] hold the numbers of a mean grasp of each object: open, closed and held. The hand
starts more or less closed. The script opens it, moves the arm down, moves the numbers from open to closed, and moves the
arm up. It ends with a status of 1 if the object is not lifted by at least 5 cm.
"""

import argparse
import pathlib
import sys

import mujoco

from eigenhand import Policy, Synergy
from eigenhand.scene import Camera, load_model, read_references

# Seconds of each part of the grasp.
OPEN, DOWN, CLOSE, SQUEEZE, UP, HOLD = 0.6, 0.8, 0.8, 0.3, 1.0, 0.5
LEAST_LIFT = 0.05
# The policy closes the hand while it comes down. The script brings the hand down first, and lower by so many metres.
LOWER = 0.04


def drive(export, synergy, policy, reference, picture):
    """Grasps and lifts one object, and returns how far it was lifted, in m."""
    model = load_model(export / "scenes" / f"{reference['object']}.xml")
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = reference["qpos"], reference["ctrl"]
    actuators = [model.actuator(name).id for name in synergy.actuators]
    # The only actuator that the synergy does not command is the slide, which stands for the arm.
    (arm,) = set(range(model.nu)) - set(actuators)
    arm_joint = model.actuator(arm).name
    place = model.joint(policy.config["scene"]["object_joint"]).qposadr[0] + 2
    moments = synergy.grasp(reference["object"])
    opened, closed, held = (z for z, _ in moments.values())
    height = {moment: q[synergy.joints.index(arm_joint)] for moment, (_, q) in moments.items()}
    start, low, high = data.ctrl[arm], height["closed"] - LOWER, height["held"]

    def move(seconds, numbers_from, numbers_to, arm_from, arm_to):
        steps = round(seconds / policy.config["control_period_s"])
        for step in range(1, steps + 1):
            share = step / steps
            data.ctrl[actuators] = synergy.command(numbers_from + share * (numbers_to - numbers_from))
            data.ctrl[arm] = arm_from + share * (arm_to - arm_from)
            mujoco.mj_step(model, data, policy.config["substeps"])

    mujoco.mj_forward(model, data)
    before = data.qpos[place]
    move(OPEN, opened, opened, start, start)
    move(DOWN, opened, opened, start, low)
    move(CLOSE, opened, closed, low, low)
    move(SQUEEZE, closed, held, low, low)
    move(UP, held, held, low, high)
    move(HOLD, held, held, high, high)
    if picture:
        from PIL import Image

        Image.fromarray(Camera(model).picture(data)).save(picture)
    return data.qpos[place] - before


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("export", type=pathlib.Path)
    parser.add_argument("--object", help="object to grasp; all of them without this option")
    parser.add_argument("--numbers", type=int, help="how many numbers command the hand; all of them by default")
    parser.add_argument("--render", metavar="FILE.png", help="writes a picture of the last grasp")
    arguments = parser.parse_args()
    policy, synergy = Policy.load(arguments.export), Synergy.load(arguments.export)
    synergy = synergy if arguments.numbers is None else synergy.first(arguments.numbers)
    references = {reference["object"]: reference for reference in read_references(arguments.export)}
    lifts = []
    for name in [arguments.object] if arguments.object else synergy.objects:
        if name not in references:
            raise ValueError(f"unknown object {name}; the export has {', '.join(references)}")
        lifts.append(drive(arguments.export, synergy, policy, references[name], arguments.render))
        print(f"{name}: lifted by {100 * lifts[-1]:.1f} cm")
    lifted = sum(lift >= LEAST_LIFT for lift in lifts)
    print(f"numbers: {synergy.k}; {lifted} of {len(lifts)} objects lifted")
    sys.exit(0 if lifted == len(lifts) else 1)


if __name__ == "__main__":
    try:
        main()
    except (ValueError, OSError) as error:
        sys.exit(f"drive_synergy: {error}")
