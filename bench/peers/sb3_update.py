"""Updates a second of Stable-Baselines3's DDPG on one thread of the CPU.

The networks, the batch and the sizes are those of this project's learner: three hidden layers of 256 for actor and
critic, float32. An update is what `DDPG.train` does: draw a minibatch, update critic, actor and both targets. The
observation and the goal are one vector, which spares Stable-Baselines3 the cost of its dictionary observations and of
relabelling goals. The last line printed is a JSON document.
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
from stable_baselines3 import DDPG
from stable_baselines3.common.logger import configure

BUFFER = 100_000
CHUNK = 10
WARMUP = 20


class Sizes(gym.Env):
    """An environment that is asked for its spaces only."""

    def __init__(self, observation, action):
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (observation,), np.float32)
        self.action_space = gym.spaces.Box(-1, 1, (action,), np.float32)

    def reset(self, seed=None, options=None):
        return np.zeros(self.observation_space.shape, np.float32), {}


def filled(model, observation, action, random):
    """Fills the replay buffer with noise."""
    buffer = model.replay_buffer
    for name, width in (("observations", observation), ("next_observations", observation), ("actions", action)):
        getattr(buffer, name)[:, 0] = random.uniform(-1, 1, (BUFFER, width)).astype(np.float32)
    buffer.rewards[:, 0] = random.integers(-1, 1, BUFFER)
    buffer.full = True


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--obs", type=int, default=64)
    parser.add_argument("--goal", type=int, default=3)
    parser.add_argument("--act", type=int, default=21)
    options = parser.parse_args()

    torch.set_num_threads(1)
    observation = options.obs + options.goal
    widths = [256, 256, 256]
    model = DDPG(
        "MlpPolicy",
        Sizes(observation, options.act),
        learning_rate=1e-3,
        buffer_size=BUFFER,
        batch_size=options.batch,
        tau=0.005,
        gamma=0.98,
        policy_kwargs={"net_arch": {"pi": widths, "qf": widths}},
        device="cpu",
        seed=0,
    )
    model.set_logger(configure(None, []))
    filled(model, observation, options.act, np.random.default_rng(0))
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
