"""Trains a policy with Stable-Baselines3 in the task of an export: DDPG with hindsight experience replay.

    python train_sb3.py EXPORT [--numbers K] [--steps N]

EXPORT is a run directory, or what `cargo xtask export` wrote. With --numbers, the policy commands the slide and K numbers of
the control synergy, and else every joint. `pip install './python[gymnasium]' stable-baselines3`.
"""

import argparse

import gymnasium
import numpy as np
from stable_baselines3 import DDPG, HerReplayBuffer
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.noise import NormalActionNoise

import eigenhand  # noqa: F401  registers the environment


def success_rate(model, env, episodes):
    successes = []
    evaluate_policy(
        model,
        env,
        n_eval_episodes=episodes,
        callback=lambda now, _: successes.append(now["info"]["is_success"]) if now["done"] else None,
    )
    return np.mean(successes)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("export")
    parser.add_argument("--numbers", type=int, help="numbers of the control synergy that command the hand")
    parser.add_argument("--objects", nargs="+", help="objects to grasp; all of the export's by default")
    parser.add_argument("--steps", type=int, default=100_000, help="environment steps of the training")
    parser.add_argument("--episodes", type=int, default=20, help="episodes of the evaluation at the end")
    options = parser.parse_args()

    space = {"action": "joints"} if options.numbers is None else {"action": "synergy", "numbers": options.numbers}
    env = Monitor(gymnasium.make("eigenhand/Grasp-v0", export=options.export, objects=options.objects, **space))
    n_actions = env.action_space.shape[0]
    model = DDPG(
        "MultiInputPolicy",
        env,
        gamma=0.98,
        learning_starts=1_000,
        train_freq=(1, "episode"),
        gradient_steps=20,
        action_noise=NormalActionNoise(np.zeros(n_actions), 0.2 * np.ones(n_actions)),
        replay_buffer_class=HerReplayBuffer,
        # The reward depends on whether the object is held, which is in the infos.
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future", "copy_info_dict": True},
        policy_kwargs={"net_arch": [256, 256, 256]},
        verbose=1,
    )
    model.learn(options.steps)
    print(f"success: {success_rate(model, env, options.episodes):.0%} of {options.episodes} episodes")


if __name__ == "__main__":
    main()
