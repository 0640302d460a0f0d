"""Environment steps a second of Stable-Baselines3's DDPG with hindsight replay, environments side by side.

As `sb3_training.py`, but there is an environment for each core, in a process of its own (`SubprocVecEnv`).
"""

from sb3_training import main

if __name__ == "__main__":
    main(parallel=True)
