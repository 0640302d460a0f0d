"""`motors.toml`: from a synergy's commands to what the motors of a real hand take."""

import numpy as np

from eigenhand.files import FormatError, read_toml, value

SCHEMA = 1


class Motors:
    """The motors of a hand, one for each of a synergy's actuators and in their order.

    A motor takes `offset + sign * scale * command`, clamped to its limits. `ids` are the motors' numbers on their bus.
    """

    def __init__(self, config, synergy, path="motors.toml"):
        if value(config, "schema", path) != SCHEMA:
            raise FormatError(f"{path} has version {config['schema']}, and this package reads version {SCHEMA}")
        entries = value(config, "motors", path)
        by_actuator = {value(entry, "actuator", path): entry for entry in entries}
        missing = [name for name in synergy.actuators if name not in by_actuator]
        if missing or len(entries) != len(synergy.actuators):
            expected = f"one motor for each of the {len(synergy.actuators)} actuators"
            raise FormatError(f"{path} has {len(entries)} motors, and none for {missing}; expected {expected}")
        self.motors = [by_actuator[name] for name in synergy.actuators]
        self.ids = [value(motor, "id", path) for motor in self.motors]
        if len(set(self.ids)) < len(self.ids):
            raise FormatError(f"{path}: two motors have the same id")
        self.offset, self.lower, self.upper = (
            np.array([value(motor, key, path) for motor in self.motors], float) for key in ("offset", "lower", "upper")
        )
        signs, scales = ([value(motor, key, path) for motor in self.motors] for key in ("sign", "scale"))
        if not all(sign in (1, -1) for sign in signs) or not all(np.isfinite(s) and s > 0 for s in scales):
            raise FormatError(f"{path}: every sign is 1 or -1, and every scale a positive number")
        self.slope = np.array(signs, float) * np.array(scales, float)

    @classmethod
    def load(cls, path, synergy):
        """Reads `motors.toml` for a synergy."""
        return cls(read_toml(path), synergy, path)

    def values(self, command):
        """(..., n) commands => (..., n) values of the motors, each within its limits."""
        return np.clip(self.offset + self.slope * np.asarray(command, float), self.lower, self.upper)

    def commands(self, values):
        """(..., n) values of the motors => (..., n) commands."""
        return (np.asarray(values, float) - self.offset) / self.slope
