"""Drive a robot hand with a few numbers: read, run and simulate what Eigenhand trained.

`Synergy` turns numbers into commands and joint positions, and back. `Policy` is a trained policy. Both need NumPy only.
`eigenhand.scene` plays episodes in MuJoCo. Where Gymnasium is installed, importing this package registers the task as the
environment `eigenhand/Grasp-v0` (`eigenhand.environment`).
"""

from importlib import metadata

from eigenhand.files import FormatError
from eigenhand.motors import Motors
from eigenhand.policy import Policy
from eigenhand.synergy import Synergy, ready

try:
    import gymnasium
except ModuleNotFoundError:
    pass
else:
    gymnasium.register("eigenhand/Grasp-v0", entry_point="eigenhand.environment:GraspEnv")

__version__ = metadata.version("eigenhand")
__all__ = ["FormatError", "Motors", "Policy", "Synergy", "ready"]
