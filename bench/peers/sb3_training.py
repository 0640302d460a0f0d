"""Environment steps a second of Stable-Baselines3's DDPG with hindsight experience replay: simulation and learning.

The scenes, the observation, the goal, the map from action to control, the substeps and the length of an episode are
those of a run directory of this project, read as `examples/python/run_policy.py` reads them; the networks, the batch
and the number of updates for each episode are given. Some things are less work than in this project: an episode begins
with the object at rest instead of letting it fall, the reward asks for the distance alone and not for contacts, inputs
are not normalised, and the critic has no layer normalisation. One environment in this process, as Stable-Baselines3 has
it by default; `sb3_vec_training.py` has one for each core. The last line printed is a JSON document.
"""

import argparse
import json
import os
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "examples" / "python"))

import gymnasium as gym
import mujoco
import numpy as np
import stable_baselines3
import torch
from run_policy import Policy, Scene
from stable_baselines3 import DDPG, HerReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.vec_env import SubprocVecEnv

BUFFER = 1_000_000
# Episodes with updates before the clock starts.
UNTIMED = 2
OBJECT = ("x", "y", "z", "qw", "qx", "qy", "qz"), ("vx", "vy", "vz", "wx", "wy", "wz")
UPPER = np.triu_indices(3)
SHAPE = [f"shape_{'xyz'[i]}{'xyz'[j]}" for i, j in zip(*UPPER)]


class FastScene(Scene):
    """A scene whose observation is copied from known places instead of looked up by name."""

    def __init__(self, run, policy, reference):
        super().__init__(run, policy, reference)
        self.low, self.span = policy.low, policy.high - policy.low
        self.n_qpos, self.n_state = self.model.nq, self.model.nq + self.model.nv
        self.state = np.empty(self.n_state + 1 + len(SHAPE))
        self.state[self.n_state] = self.object_id
        self.columns = np.array([self.column(*source.split(":", 1)) for source in self.sources])
        self.turned, self.axes = np.empty(4), np.empty(9)
        self.has_shape = self.columns.max() > self.n_state

    def column(self, kind, name):
        """Returns where a number of the observation stands in qpos, qvel, the object's number and its shape."""
        place, speed = OBJECT
        if kind == "object":
            places = (self.object_qpos, place), (self.n_qpos + self.object_dof, speed), (self.n_state, ("id", *SHAPE))
            return next(first + names.index(name) for first, names in places if name in names)
        joint = self.id(mujoco.mjtObj.mjOBJ_JOINT, name)
        return self.model.jnt_qposadr[joint] if kind == "qpos" else self.n_qpos + self.model.jnt_dofadr[joint]

    def observe(self):
        self.state[: self.n_qpos] = self.data.qpos
        self.state[self.n_qpos : self.n_state] = self.data.qvel
        if self.has_shape:
            mujoco.mju_mulQuat(self.turned, self.data.qpos[self.object_qpos + 3 :][:4], self.principal_axes)
            mujoco.mju_quat2Mat(self.axes, self.turned)
            axes = self.axes.reshape(3, 3)
            self.state[self.n_state + 1 :] = ((axes * self.half_sizes) @ axes.T)[UPPER]
        return self.state[self.columns].astype(np.float32)

    def step(self, action):
        self.data.ctrl[:] = self.low + (np.clip(action, -1, 1) + 1) / 2 * self.span
        mujoco.mj_step(self.model, self.data, self.config["substeps"])

    def position(self):
        return self.data.qpos[self.object_qpos : self.object_qpos + 3].astype(np.float32)


class Grasp(gym.Env):
    """The task of a run directory, one of its objects in each episode."""

    def __init__(self, run, seed):
        policy = Policy(run)
        references = json.loads((run / "scenes" / "reference.json").read_text())
        self.config = policy.config
        self.scenes = [FastScene(run, policy, reference) for reference in references]
        self.scene, self.goal, self.steps = self.scenes[0], np.zeros(3, np.float32), 0
        self.random = np.random.default_rng(seed)

        def box(n):
            return gym.spaces.Box(-np.inf, np.inf, (n,), np.float32)

        sizes = {"observation": len(self.config["observation"]), "achieved_goal": 3, "desired_goal": 3}
        self.observation_space = gym.spaces.Dict({name: box(n) for name, n in sizes.items()})
        self.action_space = gym.spaces.Box(-1, 1, (len(self.config["action"]),), np.float32)

    def observe(self):
        position = self.scene.position()
        return {"observation": self.scene.observe(), "achieved_goal": position, "desired_goal": self.goal}

    def reset(self, seed=None, options=None):
        self.scene, self.steps = self.scenes[self.random.integers(len(self.scenes))], 0
        qpos, goal = self.scene.place(self.random)
        self.goal = goal.astype(np.float32)
        self.scene.reset(qpos)
        return self.observe(), {}

    def step(self, action):
        self.scene.step(action)
        self.steps += 1
        observation = self.observe()
        reward = float(self.compute_reward(observation["achieved_goal"], self.goal, None))
        return observation, reward, False, self.steps >= self.config["episode_steps"], {}

    def compute_reward(self, achieved, desired, info):
        far = np.linalg.norm(achieved - desired, axis=-1) > self.config["success_distance_m"]
        return -far.astype(np.float32)


class Clock(BaseCallback):
    """Counts environment steps and updates from one rollout's start, after warm-up, to another's."""

    def __init__(self, first_step, seconds):
        super().__init__()
        self.first_step, self.seconds = first_step, seconds
        self.begin = self.end = None

    def _on_rollout_start(self):
        now = (time.perf_counter(), self.num_timesteps, self.model._n_updates)
        if self.begin is None and self.num_timesteps >= self.first_step:
            self.begin = now
        elif self.begin is not None and now[0] - self.begin[0] >= self.seconds:
            self.end = now

    def _on_step(self):
        return self.end is None

    def rates(self):
        (begin, *before), (end, *after) = self.begin, self.end
        return [(b - a) / (end - begin) for a, b in zip(before, after)]


def main(parallel=False):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--run", type=pathlib.Path, required=True, help="run directory")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--hidden", type=int, nargs="+", default=[256, 256, 256])
    parser.add_argument("--updates", type=int, default=20, help="updates for each episode")
    parser.add_argument("--warmup", type=int, default=10, help="episodes before the first update")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    options = parser.parse_args()

    torch.set_num_threads(options.threads)
    n_envs = options.threads if parallel else 1
    makers = [lambda seed=seed: Grasp(options.run, seed) for seed in range(n_envs)]
    env = SubprocVecEnv(makers) if parallel else makers[0]()
    one = makers[0]()
    steps, n_actions = one.config["episode_steps"], one.action_space.shape[0]
    model = DDPG(
        "MultiInputPolicy",
        env,
        learning_rate=1e-3,
        buffer_size=BUFFER,
        learning_starts=options.warmup * steps,
        batch_size=options.batch,
        tau=0.005,
        gamma=0.98,
        train_freq=(steps // n_envs, "step"),
        gradient_steps=options.updates,
        action_noise=NormalActionNoise(np.zeros(n_actions), 0.1 * np.ones(n_actions)),
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        policy_kwargs={"net_arch": {"pi": options.hidden, "qf": options.hidden}},
        device="cpu",
        seed=0,
    )
    clock = Clock((options.warmup + UNTIMED) * steps, options.seconds)
    model.learn(10**9, callback=clock, log_interval=None)
    env_steps, updates = clock.rates()
    record = {
        "env_steps_per_s": env_steps,
        "updates_per_s": updates,
        "threads": torch.get_num_threads(),
        "environments": n_envs,
        "mujoco": mujoco.__version__,
        "torch": torch.__version__,
        "stable_baselines3": stable_baselines3.__version__,
    }
    print(json.dumps(record))
    env.close()


if __name__ == "__main__":
    main()
