"""Environment steps a second of Stable-Baselines3's DDPG with hindsight experience replay: simulation and learning.

The task is that of a run directory of this project, in the environment of its Python package; the networks, the batch and
the number of updates for each episode are given. Two things are less work than in this project: inputs are not
normalised, and the critic has no layer normalisation. One environment in this process, as Stable-Baselines3 has it by
default; `sb3_vec_training.py` has one for each core. The last line printed is a JSON document.
"""

import argparse
import json
import os
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "python" / "src"))

import mujoco
import numpy as np
import stable_baselines3
import torch
from eigenhand.environment import GraspEnv
from stable_baselines3 import DDPG, HerReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.vec_env import SubprocVecEnv

BUFFER = 1_000_000
# Episodes with updates before the clock starts.
UNTIMED = 2


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
    makers = [lambda: GraspEnv(options.run)] * n_envs
    env = SubprocVecEnv(makers) if parallel else makers[0]()
    one = makers[0]()
    steps, n_actions = one.policy.config["episode_steps"], one.action_space.shape[0]
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
        # Whether an object is held, which the reward depends on, is in the infos.
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future", "copy_info_dict": True},
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
