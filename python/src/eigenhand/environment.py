"""The grasp task as a Gymnasium environment, `eigenhand/Grasp-v0`.

    import eigenhand, gymnasium
    env = gymnasium.make("eigenhand/Grasp-v0", export="my-shadow")

An observation is a dictionary, as HER expects it: `observation` (named in `policy.toml`), `achieved_goal` and
`desired_goal` (the place of the object, and where it is to go, x, y and z in m). A step earns 0 if the object is near its
goal and held, and -1 otherwise. An episode has a fixed number of steps, and succeeds if all of its last steps do.
"""

import pathlib

import gymnasium
import numpy as np
from gymnasium import spaces

from eigenhand.policy import Policy
from eigenhand.scene import Camera, Scene, open_viewer, read_references
from eigenhand.synergy import Synergy

ACTIONS = ("joints", "synergy")


class GraspEnv(gymnasium.Env):
    """A hand that learns to grasp and lift, on the files of a run or of an export.

    - `export`: a run directory, or what `eigenhand export` wrote.
    - `action`: "joints" commands each actuator. "synergy" commands the slide, and the numbers of the control synergy; each
      is in [-1, 1], which stands for the range that the number has in the grasps.
    - `numbers`: how many numbers, with "synergy"; all of them by default.
    - `objects`: names of objects, one of which is drawn for each episode; all of the run's by default.
    - `render_mode`: "rgb_array" or "human".

    `reset(options={"object": NAME})` chooses the object. `info` has `object`, `is_held`, and `is_success`: whether the last
    steps all succeeded.
    """

    metadata = {"render_modes": ["rgb_array", "human"]}

    def __init__(self, export, action="joints", numbers=None, objects=None, render_mode=None, width=640, height=480):
        if action not in ACTIONS:
            raise ValueError(f"action is {' or '.join(map(repr, ACTIONS))}, not {action!r}")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode is one of {self.metadata['render_modes']}, not {render_mode!r}")
        if numbers is not None and action == "joints":
            raise ValueError('numbers needs action="synergy"')
        self.directory, self.policy = pathlib.Path(export), Policy.load(export)
        self.references = {reference["object"]: reference for reference in read_references(export)}
        self.objects = list(self.references) if objects is None else list(objects)
        unknown = [name for name in self.objects if name not in self.references]
        if unknown or not self.objects:
            raise ValueError(f"unknown objects {unknown}; the run has {', '.join(self.references)}")
        self.scenes, self.camera, self.viewer = {}, None, None
        self.render_mode, self.size = render_mode, (width, height)
        config = self.policy.config
        self.metadata = {**self.metadata, "render_fps": round(1 / config["control_period_s"])}
        self.synergy, n_actions = None, len(self.policy.actuators)
        if action == "synergy":
            synergy = Synergy.load(export)
            self.synergy = synergy if numbers is None else synergy.first(numbers)
            self.driven = [self.policy.actuators.index(name) for name in self.synergy.actuators]
            self.free = [i for i in range(n_actions) if i not in self.driven]
            n_actions = len(self.free) + self.synergy.k
        self.action_space = spaces.Box(-1, 1, (n_actions,), np.float32)
        anything = [spaces.Box(-np.inf, np.inf, (n,), np.float32) for n in (len(config["observation"]), 3, 3)]
        names = ("observation", "achieved_goal", "desired_goal")
        self.observation_space = spaces.Dict(dict(zip(names, anything)))
        self.scene, self.goal, self.good = None, None, []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        name = (options or {}).get("object") or self.objects[self.np_random.integers(len(self.objects))]
        if name not in self.references:
            raise ValueError(f"unknown object {name!r}; the run has {', '.join(self.references)}")
        if name not in self.scenes:
            self.scenes[name] = Scene(self.directory, self.policy, self.references[name])
        if self.scene is not self.scenes[name]:
            self._close_views()
            self.scene = self.scenes[name]
        qpos, ctrl, self.goal = self.scene.draw(self.np_random)
        self.scene.reset(qpos, ctrl)
        self.good = []
        if self.render_mode == "human":
            self.render()
        return self._observe(), self._info()

    def step(self, action):
        if self.scene is None:
            raise RuntimeError("call reset before step")
        self.scene.step(self.actuator_action(action))
        observation, info = self._observe(), self._info()
        reward = self.compute_reward(observation["achieved_goal"], observation["desired_goal"], info)
        self.good.append(bool(reward == 0))
        info["is_success"] = self._is_success()
        if self.render_mode == "human":
            self.render()
        truncated = len(self.good) >= self.policy.config["episode_steps"]
        return observation, float(reward), False, truncated, info

    def actuator_action(self, action):
        """Turns an action of this environment into the policy's: one number in [-1, 1] for each actuator."""
        action = np.asarray(action, float)
        if action.shape != self.action_space.shape or not np.isfinite(action).all():
            raise ValueError(f"an action is {self.action_space.shape[0]} finite numbers, not {action}")
        action = np.clip(action, -1, 1)
        if self.synergy is None:
            return action
        full = np.empty(len(self.policy.actuators))
        full[self.free] = action[: len(self.free)]
        low, high = self.synergy.z_low, self.synergy.z_high
        z = low + (action[len(self.free) :] + 1) / 2 * (high - low)
        full[self.driven] = self.policy.action(self.synergy.command(z), self.driven)
        return full

    def compute_reward(self, achieved_goal, desired_goal, info):
        """(..., 3) places, (..., 3) goals, info or infos => 0 for a success, -1 otherwise.

        Whether the object is held is in `info`, so HER needs the infos of its steps: in Stable-Baselines3,
        `replay_buffer_kwargs={"copy_info_dict": True}`.
        """
        near = np.linalg.norm(achieved_goal - desired_goal, axis=-1) < self.policy.config["success_distance_m"]
        held = info["is_held"] if isinstance(info, dict) else np.array([one["is_held"] for one in info])
        return np.where(near & held, 0.0, -1.0)

    def _is_success(self):
        last = self.policy.config["final_steps"]
        return len(self.good) >= last and all(self.good[-last:])

    def _observe(self):
        places = np.float32(self.scene.place), np.float32(self.goal)
        return {"observation": self.scene.observe(), "achieved_goal": places[0], "desired_goal": places[1]}

    def _info(self):
        return {"object": self.scene.object, "is_held": self.scene.is_held(), "is_success": False}

    def render(self):
        if self.scene is None or self.render_mode is None:
            return None
        if self.render_mode == "human":
            if self.viewer is None:
                self.viewer = open_viewer(self.scene)
            self.viewer.sync()
            return None
        if self.camera is None:
            self.camera = Camera(self.scene.model, *self.size)
        return self.camera.picture(self.scene.data)

    def _close_views(self):
        for view in (self.camera, self.viewer):
            if view is not None:
                view.close()
        self.camera = self.viewer = None

    def close(self):
        self._close_views()
