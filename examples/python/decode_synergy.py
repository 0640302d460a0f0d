"""Turns a few coefficients into actuator commands and joint angles.

    python decode_synergy.py RUN/synergy 0.5 -0.2

Coefficients that are left out are 0. Given fewer than the synergy has, the script uses the first components only, which
is the same. `mean` and `components` are also in `mean.npy` and `components.npy`, for programs that do not read TOML.
The directory `RUN/synergy-postures`, the synergy of end postures, works too.
"""

import pathlib
import sys

import numpy as np

try:
    import tomllib
except ModuleNotFoundError:  # Python before 3.11: pip install tomli
    import tomli as tomllib


def limits(entries):
    """Returns the lower and the upper limits of joints or actuators."""
    return [entry["lower"] for entry in entries], [entry["upper"] for entry in entries]


def decode(synergy, z):
    """Returns joints, their positions, names of actuators, and their commands."""
    mean, components = np.array(synergy["mean"]), np.array(synergy["components"])
    if synergy["space"] == "commands":
        actuators, joint_map = synergy["actuators"], synergy["joint_map"]
        ctrl = np.clip(mean + z @ components, *limits(actuators))
        joints = joint_map["joints"]
        q = np.clip(np.array(joint_map["mean"]) + z @ np.array(joint_map["matrix"]), *limits(joints))
        return joints, q, [actuator["name"] for actuator in actuators], ctrl
    joints, actuation = synergy["joints"], synergy["actuation"]
    q = np.clip(mean + z @ components, *limits(joints))
    ctrl = np.array(actuation["matrix"]) @ q + actuation["offset"]
    return joints, q, actuation["actuators"], np.clip(ctrl, actuation["control_min"], actuation["control_max"])


def main(directory, *coefficients):
    synergy = tomllib.loads((pathlib.Path(directory) / "synergy.toml").read_text())
    n_components = len(synergy["components"])
    if len(coefficients) > n_components:
        sys.exit(f"the synergy has {n_components} components, but {len(coefficients)} coefficients were given")
    z = np.zeros(n_components)
    z[: len(coefficients)] = [float(c) for c in coefficients]
    joints, q, actuators, ctrl = decode(synergy, z)
    print(f"{synergy['hand']}: {len(z)} coefficients of a space of {synergy['space']}")
    for i, (low, high) in enumerate(zip(synergy["coefficient_min"], synergy["coefficient_max"])):
        share = synergy["contribution"][i]
        print(f"  z{i + 1} = {z[i]:+.3f}, in the samples {low:+.3f} to {high:+.3f}, {share:.1%} of the variance")
    if "recommended_components" in synergy:
        print(f"  {synergy['recommended_components']} are enough: {synergy['recommended_reason']}")
    print("joint angles")
    for joint, value in zip(joints, q):
        print(f"  {joint['name']:12} {value:+.4f} {joint['unit']}")
    print("actuator commands")
    for name, value in zip(actuators, ctrl):
        print(f"  {name:12} {value:+.4f}")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:])
