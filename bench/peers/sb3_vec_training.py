"""Environment steps a second of Stable-Baselines3's DDPG with hindsight experience replay, one environment for each core.

As `sb3_training.py`, but the environments are processes of their own (`SubprocVecEnv`), which step side by side.
"""

from sb3_training import main

if __name__ == "__main__":
    main(parallel=True)
