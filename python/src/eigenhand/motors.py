"""`motors.toml`: from a synergy's commands to what the motors of a real hand take."""

import numpy as np

from eigenhand.files import FormatError, last_axis, read_toml, value

SCHEMA = 1
KEYS = {"actuator", "joints", "id", "sign", "scale", "offset", "lower", "upper"}


class Motors:
    """The motors of a hand, one for each of a synergy's actuators and in their order.

    A motor takes `offset + sign * scale * command`, clamped to its limits. `ids` are the motors' numbers on their bus.
    """

    def __init__(self, config, synergy, path="motors.toml"):
        if value(config, "schema", path) != SCHEMA:
            raise FormatError(f"{path} has version {config['schema']}, and this package reads version {SCHEMA}")
        if value(config, "hand", path) != synergy.hand:
            raise FormatError(f"{path} is of the hand {config['hand']}, and the synergy is of {synergy.hand}")
        entries = value(config, "motors", path)
        if not all(isinstance(entry, dict) and set(entry) <= KEYS for entry in entries):
            raise FormatError(f"{path}: a motor has the entries {', '.join(sorted(KEYS))}, and no others")
        by_actuator = {value(entry, "actuator", path): entry for entry in entries}
        missing = [name for name in synergy.actuators if name not in by_actuator]
        if missing or len(entries) != len(synergy.actuators):
            expected = f"one motor for each of the {len(synergy.actuators)} actuators"
            raise FormatError(f"{path} has {len(entries)} motors, and none for {missing}; expected {expected}")
        self.motors = [by_actuator[name] for name in synergy.actuators]

        def column(key, kind):
            found = [value(motor, key, path) for motor in self.motors]
            if not all(isinstance(entry, kind) and not isinstance(entry, bool) for entry in found):
                raise FormatError(f"{path}: every {key} is a number")
            return found

        self.ids = column("id", int)
        if len(set(self.ids)) < len(self.ids):
            raise FormatError(f"{path}: two motors have the same id")
        sign, scale, self.offset, self.lower, self.upper = (
            np.array(column(key, (int, float)), float) for key in ("sign", "scale", "offset", "lower", "upper")
        )
        if not np.isin(sign, (1, -1)).all() or not (np.isfinite(scale) & (scale > 0)).all():
            raise FormatError(f"{path}: every sign is 1 or -1, and every scale a positive number")
        if not np.isfinite(self.offset).all() or not (self.lower < self.upper).all():
            raise FormatError(f"{path}: every offset is finite, and every lower limit below the upper one")
        self.slope = sign * scale

    @classmethod
    def load(cls, path, synergy):
        """Reads `motors.toml` for a synergy."""
        return cls(read_toml(path), synergy, path)

    def values(self, command):
        """(..., n) commands => (..., n) values of the motors, each within its limits."""
        command = last_axis(command, len(self.motors), "commands")
        return np.clip(self.offset + self.slope * command, self.lower, self.upper)

    def commands(self, values):
        """(..., n) values of the motors => (..., n) commands."""
        return (last_axis(values, len(self.motors), "values") - self.offset) / self.slope
