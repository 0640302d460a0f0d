"""A trained policy: observation and goal in, action out."""

import copy
import pathlib

import numpy as np

from eigenhand.files import read_safetensors, read_toml, value

SCHEMA = 1


class Policy:
    """The actor of a run: an observation and a goal in, an action in [-1, 1] for each of `actuators` out.

    `config` is `policy.toml`; its `observation` names every number of an observation. `low` and `high` are the actuators'
    ranges, onto which `command` maps an action.
    """

    def __init__(self, config, tensors, path="policy.toml"):
        self.config, self.path, self.tensors = config, path, tensors
        self.scaling = {name: (tensors[name + ".mean"], tensors[name + ".std"]) for name in ("observation", "goal")}
        n_layers = sum(name.startswith("actor.") and name.endswith(".bias") for name in tensors)
        self.layers = [(tensors[f"actor.{i}.weight"], tensors[f"actor.{i}.bias"]) for i in range(n_layers)]
        # A policy that was confined to a synergy has a map from its outputs to actions.
        self.map = (tensors["action.matrix"], tensors["action.offset"]) if "action.matrix" in tensors else None
        action = value(config, "action", path)
        self.actuators = [actuator["actuator"] for actuator in action]
        self.low = np.array([actuator["low"] for actuator in action])
        self.high = np.array([actuator["high"] for actuator in action])
        self.space = None

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
        stands for the arm, stays free.
        """
        policy = copy.copy(self)
        indices = [self.actuators.index(name) for name in synergy.actuators]
        policy.space = indices, synergy.mean, synergy.components
        if synergy.k < len(synergy.config["components"]) and "numbers.weight" in self.tensors:
            weight, bias = self.layers[0]
            told = bias + self.tensors["numbers.weight"] / max(synergy.k, 1)
            policy.layers = [(weight, told), *self.layers[1:]]
        return policy

    def _project(self, action):
        indices, mean, rows = self.space
        command = self.command(action, clip=False)[indices]
        projected = np.array(action, float)
        projected[indices] = self.action(mean + (command - mean) @ rows.T @ rows, indices)
        return projected

    def _normalise(self, name, x):
        (mean, std), clip = self.scaling[name], self.config["normalizer"]
        raw = np.clip(np.asarray(x, np.float32), -clip["raw_clip"], clip["raw_clip"])
        return np.clip((raw - mean) / std, -clip["norm_clip"], clip["norm_clip"])

    def act(self, observation, goal):
        """Observation and goal (the object's place, x, y and z in m) => action in [-1, 1], without noise."""
        x = np.concatenate([self._normalise("observation", observation), self._normalise("goal", goal)])
        for weight, bias in self.layers[:-1]:
            x = np.maximum(weight @ x + bias, 0)
        weight, bias = self.layers[-1]
        output = np.tanh(weight @ x + bias)
        if self.map is not None:
            matrix, offset = self.map
            output = matrix @ output + offset
        if self.space is not None:
            output = self._project(output)
        return np.clip(output, -1, 1)

    def command(self, action, clip=True):
        """Action => commands of `actuators`, in rad or m for position servos."""
        action = np.asarray(action, float)
        unit = (np.clip(action, -1, 1) if clip else action) / 2 + 0.5
        return self.low + unit * (self.high - self.low)

    def action(self, command, indices=slice(None)):
        """Commands of `actuators`, or of some of them => action."""
        low, half = self.low[indices], (self.high - self.low)[indices] / 2
        return np.divide(np.asarray(command) - low, half, out=np.ones(len(half)), where=half > 0) - 1
