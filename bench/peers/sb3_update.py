"""Updates a second of Stable-Baselines3's DDPG on one thread of the CPU, without hindsight.

The networks, the batch and the sizes are those of this project's learner: three hidden layers of 256 for actor and
critic, float32. An update is what `DDPG.train` does: draw a minibatch, update critic, actor and both targets. The
observation and the goal are one vector, which spares Stable-Baselines3 its dictionary observations and the relabelling
of goals; `sb3_her_update.py` has both. The last line printed is a JSON document.
"""

import argparse
import json
import os
import time

for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"

import gymnasium as gym
import numpy as np
import stable_baselines3
import torch
from stable_baselines3 import DDPG, HerReplayBuffer
from stable_baselines3.common.logger import configure

BUFFER = 100_000
EPISODE = 100
CHUNK = 10
WARMUP = 20


class Sizes(gym.Env):
    """An environment that is asked for its spaces, and for rewards in hindsight."""

    def __init__(self, options, her):
        def box(n):
            return gym.spaces.Box(-np.inf, np.inf, (n,), np.float32)

        goals = {"achieved_goal": box(options.goal), "desired_goal": box(options.goal)}
        plain = box(options.obs + options.goal)
        self.observation_space = gym.spaces.Dict({"observation": box(options.obs), **goals}) if her else plain
        self.action_space = gym.spaces.Box(-1, 1, (options.act,), np.float32)

    def reset(self, seed=None, options=None):
        return self.observation_space.sample(), {}

    def compute_reward(self, achieved, desired, info):
        return -(np.linalg.norm(achieved - desired, axis=-1) > 0.5).astype(np.float32)


def fill(buffer, random):
    """Fills a replay buffer with episodes of noise."""

    def noise(array):
        array[:] = random.uniform(-1, 1, array.shape).astype(array.dtype)

    for part in (buffer.observations, buffer.next_observations, buffer.actions):
        for array in part.values() if isinstance(part, dict) else [part]:
            noise(array)
    buffer.rewards[:] = random.integers(-1, 1, buffer.rewards.shape)
    buffer.full = True
    if isinstance(buffer, HerReplayBuffer):
        buffer.ep_start[:, 0] = np.arange(BUFFER) // EPISODE * EPISODE
        buffer.ep_length[:] = EPISODE


def main(her=False):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--obs", type=int, default=64)
    parser.add_argument("--goal", type=int, default=3)
    parser.add_argument("--act", type=int, default=21)
    options = parser.parse_args()

    torch.set_num_threads(1)
    widths = [256, 256, 256]
    model = DDPG(
        "MultiInputPolicy" if her else "MlpPolicy",
        Sizes(options, her),
        learning_rate=1e-3,
        buffer_size=BUFFER,
        batch_size=options.batch,
        tau=0.005,
        gamma=0.98,
        replay_buffer_class=HerReplayBuffer if her else None,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"} if her else None,
        policy_kwargs={"net_arch": {"pi": widths, "qf": widths}},
        device="cpu",
        seed=0,
    )
    model.set_logger(configure(None, []))
    fill(model.replay_buffer, np.random.default_rng(0))
    model.train(gradient_steps=WARMUP, batch_size=options.batch)
    updates, start = 0, time.perf_counter()
    while time.perf_counter() - start < options.seconds:
        model.train(gradient_steps=CHUNK, batch_size=options.batch)
        updates += CHUNK
    record = {
        "updates_per_s": updates / (time.perf_counter() - start),
        "threads": torch.get_num_threads(),
        "torch": torch.__version__,
        "stable_baselines3": stable_baselines3.__version__,
    }
    print(json.dumps(record))


if __name__ == "__main__":
    main()
