"""A synergy: a few numbers in, commands and joint positions out, and back."""

import pathlib

import numpy as np

from eigenhand.files import FormatError, read_toml, value

SCHEMA = 2
# Where ready synergies are: beside this file in a wheel, and at the root of a checkout.
READY = [pathlib.Path(__file__).parent / "synergies", pathlib.Path(__file__).parents[3] / "synergies"]
# The moments of a mean grasp, in their order.
MOMENTS = ("open", "closed", "held")


def ready():
    """Returns the names of the hands of which a synergy comes with this package."""
    return sorted({path.parent.name for place in READY for path in place.glob("*/synergy.toml")})


class Synergy:
    """k numbers z that move all joints of a hand together.

    A *control synergy* (`space` is "commands") is a mean command and k components, fitted to the commands of whole grasps.
    A *synergy of end postures* (`space` is "postures") is a mean posture and k components. Both give commands and joint
    positions; the control synergy is the one that drives a hand.

    Attributes, all of which are arrays in the order of the names beside them:

    - `k`: how many numbers.
    - `actuators`, `actuator_low`, `actuator_high`: names and ranges of the commands, in rad or m for position servos.
    - `joints`, `joint_low`, `joint_high`: names and limits of the joint positions, in rad or m.
    - `free`: names of joints that no command moves, such as that of the slide, which stands for the arm.
    - `mean` (n), `components` (k x n): of the commands, or of the postures.
    - `z_low`, `z_high` (k): the range of each number in the samples.
    """

    def __init__(self, config, path="synergy.toml"):
        def get(key, table=config):
            return value(table, key, path)

        if get("schema") != SCHEMA:
            raise FormatError(f"{path} has version {config['schema']}, and this package reads version {SCHEMA}")
        self.config, self.path, self.hand, self.space = config, path, get("hand"), get("space")
        self.mean, self.components = np.array(get("mean"), float), np.array(get("components"), float)
        self.k = len(self.components)
        self.contribution = np.array(get("contribution"), float)
        self.z_low = np.array(get("coefficient_min"), float)
        self.z_high = np.array(get("coefficient_max"), float)
        if self.space == "commands":
            joint_map = get("joint_map")
            joints, actuators = get("joints", joint_map), get("actuators")
            self.actuators = [entry["name"] for entry in actuators]
            self.actuator_low = np.array([entry["lower"] for entry in actuators], float)
            self.actuator_high = np.array([entry["upper"] for entry in actuators], float)
            self.free = list(joint_map.get("free", []))
            self.joint_mean = np.array(get("mean", joint_map), float)
            self.joint_matrix = np.array(get("matrix", joint_map), float)
        else:
            joints, actuation, self.free = get("joints"), get("actuation"), []
            self.actuators = get("actuators", actuation)
            self.actuator_low = np.array(get("control_min", actuation), float)
            self.actuator_high = np.array(get("control_max", actuation), float)
            self.joint_mean, self.joint_matrix = self.mean, self.components
        self.joints = [entry["name"] for entry in joints]
        self.joint_low = np.array([entry["lower"] for entry in joints], float)
        self.joint_high = np.array([entry["upper"] for entry in joints], float)

    @classmethod
    def load(cls, path):
        """Reads a synergy: `synergy.toml`, the directory of it, a run or an export that has one, or the name of a ready one.

        The ready synergies come with this package; `ready()` lists them.
        """
        path = pathlib.Path(path)
        places = [path / "synergy.toml", path / "synergy" / "synergy.toml", path]
        places += [ready / path / "synergy.toml" for ready in READY]
        found = next((place for place in places if place.is_file()), None)
        if found is None:
            known = ", ".join(ready())
            raise FileNotFoundError(
                f"{path} has no synergy.toml: name a run that has succeeded, an export of it, or a ready synergy ({known})"
            )
        return cls(read_toml(found), found)

    def first(self, k):
        """Returns the synergy of the first k numbers."""
        if not 0 <= k <= self.k:
            raise ValueError(f"this synergy has 0 to {self.k} numbers, not {k}")
        short = Synergy(self.config, self.path)
        short.k, short.components, short.joint_matrix = k, self.components[:k], self.joint_matrix[:k]
        for name in ("contribution", "z_low", "z_high"):
            setattr(short, name, getattr(self, name)[:k])
        return short

    def _numbers(self, z):
        z = np.asarray(z, float)
        if z.shape[-1:] > (self.k,) or z.ndim == 0:
            raise ValueError(f"this synergy has {self.k} numbers, but an array of shape {z.shape} was given")
        # Numbers that are left out are 0.
        return np.concatenate([z, np.zeros((*z.shape[:-1], self.k - z.shape[-1]))], axis=-1)

    def command(self, z):
        """(..., up to k) numbers => (..., n) commands of `actuators`, clamped to their ranges."""
        if self.space == "commands":
            command = self.mean + self._numbers(z) @ self.components
        else:
            actuation = self.config["actuation"]
            command = self.decode(z) @ np.array(actuation["matrix"], float).T + np.array(actuation["offset"], float)
        return np.clip(command, self.actuator_low, self.actuator_high)

    def decode(self, z):
        """(..., up to k) numbers => (..., m) positions of `joints` in rad or m, clamped to their limits.

        Of a control synergy, they are where the joints are on average with these numbers; the object that the hand holds
        stops them earlier.
        """
        return np.clip(self.joint_mean + self._numbers(z) @ self.joint_matrix, self.joint_low, self.joint_high)

    def encode_command(self, command):
        """(..., n) commands => (..., k) numbers of a control synergy: the nearest ones, as its components are orthonormal."""
        if self.space != "commands":
            raise ValueError("a synergy of end postures encodes postures, not commands: use encode")
        return (np.asarray(command, float) - self.mean) @ self.components.T

    def encode(self, posture):
        """A measured posture => (k,) numbers whose joint positions are nearest to it, in the sense of least squares.

        `posture` is an array in the order of `joints`, or a dictionary of at least k of them. `free` joints do not count.
        """
        if isinstance(posture, dict):
            unknown = sorted(set(posture) - set(self.joints))
            if unknown:
                raise ValueError(f"unknown joints {', '.join(unknown)}; the hand has {', '.join(self.joints)}")
            measured = np.array([posture.get(name, np.nan) for name in self.joints], float)
            known = [name in posture for name in self.joints]
        else:
            measured, known = np.asarray(posture, float), [True] * len(self.joints)
            if measured.shape != (len(known),):
                raise ValueError(f"a posture has {len(known)} joints, but an array of shape {measured.shape} was given")
        used = [i for i, name in enumerate(self.joints) if known[i] and name not in self.free]
        if len(used) < self.k:
            raise ValueError(f"{len(used)} joints cannot say {self.k} numbers: name more, or use first({len(used)})")
        return np.linalg.lstsq(self.joint_matrix[:, used].T, (measured - self.joint_mean)[used], rcond=None)[0]

    @property
    def objects(self):
        """Names of the objects of which there are mean grasps."""
        return list(dict.fromkeys(grasp["object"] for grasp in self.config.get("grasps", [])))

    def grasp(self, name):
        """Returns the mean grasp of an object: its `open`, `closed` and `held` moments, each as numbers and positions."""
        # In the order of their numbers: the first that has enough has the fewest.
        fits = [g for g in self.config.get("grasps", []) if g["object"] == name and g["numbers"] >= self.k]
        if not fits:
            there = ", ".join(self.objects) or "none: the policy never succeeded with each of its numbers"
            raise ValueError(f"there is no grasp of {name!r} with {self.k} numbers; objects with grasps: {there}")
        return {m: (np.array(fits[0][m]["z"], float)[: self.k], np.array(fits[0][m]["q"], float)) for m in MOMENTS}
