"""A synergy: a few numbers in, commands and joint positions out, and back."""

import operator
import pathlib
from collections.abc import Mapping

import numpy as np

from eigenhand.files import FormatError, last_axis, limits, numbers, read_toml, value

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
        if value(config, "schema", path) != SCHEMA:
            raise FormatError(f"{path} has version {config['schema']}, and this package reads version {SCHEMA}")
        self.config, self.path = config, path
        self.hand, self.space = value(config, "hand", path), value(config, "space", path)
        if self.space not in ("commands", "postures"):
            raise FormatError(f"{path}: space is {self.space!r}, and 'commands' or 'postures' is expected")
        axes = limits(value(config, "actuators" if self.space == "commands" else "joints", path), path)
        n = len(axes[0])
        self.mean = numbers(config, "mean", path, (n,))
        self.components = numbers(config, "components", path, (None, n))
        self.k = len(self.components)
        self.contribution = numbers(config, "contribution", path, (self.k,))
        self.z_low = numbers(config, "coefficient_min", path, (self.k,))
        self.z_high = numbers(config, "coefficient_max", path, (self.k,))
        self.actuation, self.free = None, []
        joints, self.joint_mean, self.joint_matrix = ([], [], []), None, None
        if self.space == "commands":
            self.actuators, self.actuator_low, self.actuator_high = axes
            # A synergy that was fitted to a table of commands has no joint map.
            if "joint_map" in config:
                joint_map = config["joint_map"]
                joints = limits(value(joint_map, "joints", path), path)
                self.free = list(joint_map.get("free", []))
                self.joint_mean = numbers(joint_map, "mean", path, (len(joints[0]),))
                self.joint_matrix = numbers(joint_map, "matrix", path, (self.k, len(joints[0])))
        else:
            joints, self.joint_mean, self.joint_matrix = axes, self.mean, self.components
            self.actuators, self.actuator_low, self.actuator_high = [], np.zeros(0), np.zeros(0)
            # A synergy of some of the joints has no map to commands.
            if "actuation" in config:
                self.actuation = config["actuation"]
                self.actuators = value(self.actuation, "actuators", path)
                self.actuator_low = np.array(value(self.actuation, "control_min", path), float)
                self.actuator_high = np.array(value(self.actuation, "control_max", path), float)
        self.joints, self.joint_low, self.joint_high = joints

    @classmethod
    def load(cls, path):
        """Reads a synergy: `synergy.toml`, the directory of it, a run or an export that has one, or the name of a ready one.

        The ready synergies come with this package; `ready()` lists them.
        """
        path = pathlib.Path(path)
        places = [path / "synergy.toml", path / "synergy" / "synergy.toml", path]
        # A path that is there is never taken for the name of a ready synergy.
        if not path.exists() and len(path.parts) == 1:
            places = [place / path / "synergy.toml" for place in READY]
        found = next((place for place in places if place.is_file()), None)
        if found is None:
            known = ", ".join(ready())
            raise FileNotFoundError(
                f"{path} has no synergy.toml: name a run that has succeeded, an export of it, or a ready synergy ({known})"
            )
        return cls(read_toml(found), found)

    def first(self, k):
        """Returns the synergy of the first k numbers."""
        k = operator.index(k)
        if not 0 <= k <= self.k:
            raise ValueError(f"this synergy has 0 to {self.k} numbers, not {k}")
        short = Synergy(self.config, self.path)
        short.k, short.components = k, self.components[:k]
        short.joint_matrix = None if self.joint_matrix is None else self.joint_matrix[:k]
        for name in ("contribution", "z_low", "z_high"):
            setattr(short, name, getattr(self, name)[:k])
        return short

    def _numbers(self, z):
        z = np.asarray(z, float)
        if z.ndim == 0 or z.shape[-1] > self.k:
            raise ValueError(f"this synergy has {self.k} numbers, but an array of shape {z.shape} was given")
        # Numbers that are left out are 0.
        z = np.concatenate([z, np.zeros((*z.shape[:-1], self.k - z.shape[-1]))], axis=-1)
        return last_axis(z, self.k, "numbers")

    def _joint_map(self):
        if self.joint_matrix is None:
            raise ValueError(f"{self.path} has no joint map: fit it to runs or their databases, which have postures")
        return self.joint_mean, self.joint_matrix

    def command(self, z):
        """(..., up to k) numbers => (..., n) commands of `actuators`, clamped to their ranges."""
        if self.space == "commands":
            command = self.mean + self._numbers(z) @ self.components
        elif self.actuation is None:
            raise ValueError(f"{self.path} has no map to commands: it is of some of the hand's joints, or of no known hand")
        else:
            matrix, offset = (np.array(self.actuation[key], float) for key in ("matrix", "offset"))
            command = self.decode(z) @ matrix.T + offset
        return np.clip(command, self.actuator_low, self.actuator_high)

    def decode(self, z):
        """(..., up to k) numbers => (..., m) positions of `joints` in rad or m, clamped to their limits.

        Of a control synergy, they are where the joints are on average with these numbers; the object that the hand holds
        stops them earlier.
        """
        mean, matrix = self._joint_map()
        return np.clip(mean + self._numbers(z) @ matrix, self.joint_low, self.joint_high)

    def encode_command(self, command):
        """(..., n) commands => (..., k) numbers of a control synergy: the nearest ones, as its components are orthonormal."""
        if self.space != "commands":
            raise ValueError("a synergy of end postures encodes postures, not commands: use encode")
        return (last_axis(command, len(self.actuators), "commands") - self.mean) @ self.components.T

    def encode(self, posture):
        """A measured posture => (k,) numbers whose joint positions are nearest to it, in the sense of least squares.

        `posture` is an array in the order of `joints`, or a mapping of at least k of them. `free` joints do not count. Of a
        control synergy, the numbers are rough: contacts stop the joints, so a posture does not tell what was commanded. Where
        the commands are known, use `encode_command`.
        """
        mean, matrix = self._joint_map()
        if isinstance(posture, Mapping):
            unknown = sorted(set(posture) - set(self.joints))
            if unknown:
                raise ValueError(f"unknown joints {', '.join(unknown)}; the hand has {', '.join(self.joints)}")
            known = np.array([name in posture for name in self.joints])
            posture = [posture.get(name, 0.0) for name in self.joints]
        else:
            known = np.ones(len(self.joints), bool)
        measured = last_axis(posture, len(self.joints), "posture")
        used = [i for i, name in enumerate(self.joints) if known[i] and name not in self.free]
        z, _, rank, _ = np.linalg.lstsq(matrix[:, used].T, (measured - mean)[used], rcond=None)
        if rank < self.k:
            raise ValueError(f"these {len(used)} joints tell {rank} numbers, not {self.k}: name more, or use first({rank})")
        return z

    @property
    def objects(self):
        """Names of the objects of which there are mean grasps."""
        return list(dict.fromkeys(grasp["object"] for grasp in self.config.get("grasps", [])))

    def grasp(self, name):
        """Returns the mean grasp of an object: its `open`, `closed` and `held` moments, each as numbers and positions."""
        # In the order of their numbers: the first that has enough has the fewest.
        # A file without a count means all numbers.
        count = len(self.config["components"])
        fits = [g for g in self.config.get("grasps", []) if g["object"] == name and (g.get("numbers") or count) >= self.k]
        if not fits:
            there = ", ".join(self.objects) or "none: the policy never succeeded with each of its numbers"
            raise ValueError(f"there is no grasp of {name!r} with {self.k} numbers; objects with grasps: {there}")
        return {m: (np.array(fits[0][m]["z"], float)[: self.k], np.array(fits[0][m]["q"], float)) for m in MOMENTS}
