"""Opens and closes a hand with a few numbers, 100 times a second. It needs NumPy only.

    python control_loop.py SYNERGY OBJECT

SYNERGY is a directory with `synergy.toml`, such as `synergies/shadow`. The numbers move from the open hand to the mean grasp
of the object. Replace `send` with what commands your motors. At the end, the numbers of a measured posture are computed.
"""

import pathlib
import sys
import time

import numpy as np

try:
    import tomllib
except ModuleNotFoundError:  # Python before 3.11: pip install tomli
    import tomli as tomllib

PERIOD = 0.01
# Seconds of each part of the motion.
CLOSE, SQUEEZE = 1.0, 0.5


def limits(entries):
    return [entry["lower"] for entry in entries], [entry["upper"] for entry in entries]


def send(names, command):
    """Commands the hand: each number is a joint position in rad or m, for the actuator of that name."""


def report(moment, actuators, command, joints, posture):
    for kind, entries, values in (("command", actuators, command), ("joint", joints, posture)):
        for entry, value in zip(entries, values):
            print(moment, kind, entry["name"], repr(float(value)))


def main(directory, name):
    path = pathlib.Path(directory) / "synergy.toml"
    if not path.is_file():
        sys.exit(f"there is no {path}: name a directory with synergy.toml, such as synergies/shadow or EXPORT/synergy")
    synergy = tomllib.loads(path.read_text())
    if synergy["space"] != "commands":
        sys.exit(f"{path} is a synergy of end postures, and a control synergy is needed")
    actuators, joint_map = synergy["actuators"], synergy["joint_map"]
    mean, components = np.array(synergy["mean"]), np.array(synergy["components"])
    joint_mean, joint_matrix = np.array(joint_map["mean"]), np.array(joint_map["matrix"])
    k = len(components)
    grasp = next((g for g in synergy["grasps"] if g["object"] == name and g["numbers"] == k), None)
    if grasp is None:
        sys.exit(f"there is no grasp of {name}")
    names = [actuator["name"] for actuator in actuators]

    way = [(CLOSE, "open", "closed"), (SQUEEZE, "closed", "held")]
    next_tick = time.monotonic()
    for seconds, start, end in way:
        start_z, end_z = np.array(grasp[start]["z"]), np.array(grasp[end]["z"])
        ticks = round(seconds / PERIOD)
        for tick in range(ticks + 1):
            z = start_z + tick / ticks * (end_z - start_z)
            command = np.clip(mean + z @ components, *limits(actuators))
            posture = np.clip(joint_mean + z @ joint_matrix, *limits(joint_map["joints"]))
            send(names, command)
            if tick in (0, ticks):
                report(start if tick == 0 else end, actuators, command, joint_map["joints"], posture)
            next_tick += PERIOD
            time.sleep(max(0.0, next_tick - time.monotonic()))

    # The way back: the numbers whose joint positions are nearest to a measured posture. The arm's joints do not count.
    measured = np.array(grasp["held"]["q"])
    free = joint_map.get("free", [])
    hand = [i for i, joint in enumerate(joint_map["joints"]) if joint["name"] not in free]
    numbers, *_ = np.linalg.lstsq(joint_matrix[:, hand].T, (measured - joint_mean)[hand], rcond=None)
    for i, number in enumerate(numbers):
        print("measured", "number", i + 1, repr(float(number)))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
