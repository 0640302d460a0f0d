"""Updates a second of Stable-Baselines3's DDPG with hindsight experience replay on one thread of the CPU.

As `sb3_update.py`, but with dictionary observations and a `HerReplayBuffer` that relabels four of five goals and asks
the environment for their rewards: what this project's learner does when its minibatches are drawn.
"""

from sb3_update import main

if __name__ == "__main__":
    main(her=True)
