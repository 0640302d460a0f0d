"""A trained policy: observation and goal in, action out."""

import copy
import pathlib

import numpy as np

from eigenhand.files import FormatError, last_axis, numbers, read_safetensors, read_toml, value

SCHEMA = 1


class Policy:
    """The actor of a run: an observation and a goal in, an action in [-1, 1] for each of `actuators` out.

    `config` is `policy.toml`; its `observation` names every number of an observation. `low` and `high` are the actuators'
    ranges, onto which `command` maps an action.
    """

    def __init__(self, config, tensors, path="policy.toml"):
        if value(config, "schema", path) != SCHEMA:
            raise FormatError(f"{path} has version {config['schema']}, and this package reads version {SCHEMA}")
        if "object" not in config:
            raise FormatError(f"{path} is of an earlier version of Eigenhand: export the run, and name the export")
        self.config, self.path, self.tensors, self.space = config, path, tensors, None
        action = value(config, "action", path)
        self.actuators = [value(actuator, "actuator", path) for actuator in action]
        self.low = numbers({"low": [value(actuator, "low", path) for actuator in action]}, "low", path)
        self.high = numbers({"high": [value(actuator, "high", path) for actuator in action]}, "high", path)
        if not (self.low <= self.high).all():
            raise FormatError(f"{path}: the low end of an action is above the high one")
        self.clip = {key: value(value(config, "normalizer", path), key, path) for key in ("raw_clip", "norm_clip")}
        self.observation = [value(entry, "name", path) for entry in value(config, "observation", path)]
        sizes = {"observation": len(self.observation), "goal": len(value(config, "goal", path))}
        self.scaling = {name: [self._tensor(f"{name}.{part}", n) for part in ("mean", "std")] for name, n in sizes.items()}
        width, self.layers = sum(sizes.values()), []
        while f"actor.{len(self.layers)}.weight" in tensors:
            weight, bias = (self._tensor(f"actor.{len(self.layers)}.{part}") for part in ("weight", "bias"))
            if weight.ndim != 2 or weight.shape[1] != width or bias.shape != weight.shape[:1]:
                raise FormatError(f"{path}: layer {len(self.layers)} of the policy does not fit the one before it")
            width = len(bias)
            self.layers.append((weight, bias))
        # A policy that was confined to a synergy has a map from its outputs to actions.
        self.map = None
        if "action.matrix" in tensors:
            self.map = self._tensor("action.matrix"), self._tensor("action.offset")
            width = len(self.map[1]) if self.map[0].shape == (len(self.map[1]), width) else -1
        if not self.layers or width != len(self.actuators):
            raise FormatError(f"{path}: the tensors of the policy do not give one action for each actuator")

    def _tensor(self, name, length=None):
        tensor = self.tensors.get(name)
        if tensor is None:
            raise FormatError(f"{self.path}: policy.safetensors has no {name}")
        if not np.isfinite(tensor).all() or (length is not None and tensor.shape != (length,)):
            raise FormatError(f"{self.path}: {name} of policy.safetensors is not {length or 'an array'} of finite numbers")
        return tensor

    @classmethod
    def load(cls, directory):
        """Reads the policy of a run, or of an export."""
        directory = pathlib.Path(directory)
        path = directory / "policy.toml"
        if not path.is_file():
            raise FileNotFoundError(f"{directory} has no policy.toml: name a run, or an export of it")
        return cls(read_toml(path), read_safetensors(directory / "policy.safetensors"), path)

    def with_numbers(self, synergy):
        """Returns this policy, but its commands are projected on a control synergy: its k numbers command the hand.

        If these are fewer than the policy has, it is told so. What the synergy does not command, such as the slide that
        stands for the arm, stays free. Of a policy with numbers, it returns one with these numbers in their place.
        """
        if synergy.space != "commands" or synergy.hand != self.config["hand"]:
            raise ValueError(
                f"a control synergy of the hand {self.config['hand']} is needed, and this one is of {synergy.space} of "
                f"{synergy.hand}"
            )
        policy = copy.copy(self)
        indices = [self.actuators.index(name) for name in synergy.actuators]
        policy.space = indices, synergy.mean, synergy.components
        weight, bias = self.tensors["actor.0.weight"], self.tensors["actor.0.bias"]
        if synergy.k < len(synergy.config["components"]) and "numbers.weight" in self.tensors:
            bias = bias + self.tensors["numbers.weight"] / max(synergy.k, 1)
        policy.layers = [(weight, bias), *self.layers[1:]]
        return policy

    def _project(self, action):
        indices, mean, rows = self.space
        command = self.command(action, clip=False)[..., indices]
        projected = np.array(action, float)
        projected[..., indices] = self.action(mean + (command - mean) @ rows.T @ rows, indices)
        return projected

    def _normalise(self, name, x):
        mean, std = self.scaling[name]
        raw = np.clip(np.float32(last_axis(x, len(mean), name)), -self.clip["raw_clip"], self.clip["raw_clip"])
        return np.clip((raw - mean) / std, -self.clip["norm_clip"], self.clip["norm_clip"])

    def act(self, observation, goal):
        """(..., n) observations and (..., 3) goals (the object's place, x, y and z in m) => actions in [-1, 1], without noise."""
        x = np.concatenate([self._normalise("observation", observation), self._normalise("goal", goal)], axis=-1)
        for weight, bias in self.layers[:-1]:
            x = np.maximum(x @ weight.T + bias, 0)
        weight, bias = self.layers[-1]
        output = np.tanh(x @ weight.T + bias)
        if self.map is not None:
            matrix, offset = self.map
            output = output @ matrix.T + offset
        if self.space is not None:
            output = self._project(output)
        return np.clip(output, -1, 1)

    def command(self, action, clip=True):
        """(..., n) actions => (..., n) commands of `actuators`, in rad or m for position servos."""
        action = last_axis(action, len(self.actuators), "action")
        unit = (np.clip(action, -1, 1) if clip else action) / 2 + 0.5
        return self.low + unit * (self.high - self.low)

    def action(self, command, indices=slice(None)):
        """(..., n) commands of `actuators`, or of some of them => (..., n) actions."""
        low, half = self.low[indices], (self.high - self.low)[indices] / 2
        command = last_axis(command, len(half), "commands")
        return np.divide(command - low, half, out=np.ones(command.shape), where=half > 0) - 1
