"""Turns a few coefficients into joint angles and actuator commands.

    python decode_synergy.py RUN/synergy 0.5 -0.2

Coefficients that are left out are 0, the mean posture. `mean` and `components` are also in `mean.npy` and
`components.npy`, for programs that do not read TOML.
"""

import pathlib
import sys

import numpy as np

try:
    import tomllib
except ModuleNotFoundError:  # Python before 3.11: pip install tomli
    import tomli as tomllib


def main(directory, *coefficients):
    synergy = tomllib.loads((pathlib.Path(directory) / "synergy.toml").read_text())
    mean, components = np.array(synergy["mean"]), np.array(synergy["components"])
    assert len(coefficients) <= len(components), f"the synergy has {len(components)} components"
    z = np.zeros(len(components))
    z[: len(coefficients)] = [float(c) for c in coefficients]
    joints = synergy["joints"]
    q = np.clip(mean + z @ components, [j["lower"] for j in joints], [j["upper"] for j in joints])
    print(f"{synergy['hand']}: {len(z)} coefficients stand for {len(q)} joints")
    for i, (low, high) in enumerate(zip(synergy["coefficient_min"], synergy["coefficient_max"])):
        share = synergy["contribution"][i]
        print(f"  z{i + 1} = {z[i]:+.3f}, in the postures {low:+.3f} to {high:+.3f}, {share:.1%} of the variance")
    print("joint angles")
    for joint, value in zip(joints, q):
        print(f"  {joint['name']:12} {value:+.4f} {joint['unit']}")
    actuation = synergy["actuation"]
    ctrl = np.array(actuation["matrix"]) @ q + actuation["offset"]
    print("actuator commands")
    for name, value in zip(actuation["actuators"], np.clip(ctrl, actuation["control_min"], actuation["control_max"])):
        print(f"  {name:12} {value:+.4f}")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:])
