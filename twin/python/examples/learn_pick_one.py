"""Reinforcement learning of ``ftac/PickOne-v0`` for one object with Stable-Baselines3 (PPO), from the shaped reward.

    python learn_pick_one.py --minutes 60 --out learning

It writes ``curve.csv`` (steps, minutes, successes and the mean shaped return of the test episodes) and the policy. Observations are where the palm is as the
object was seen, the servos, and the last command; actions are the environment's. It needs stable-baselines3 beside ftac.
"""

import argparse
import csv
import os
import time
from pathlib import Path

os.environ.setdefault("RAYON_NUM_THREADS", "1")

import gymnasium  # noqa: E402
import numpy as np  # noqa: E402
from stable_baselines3 import PPO  # noqa: E402
from stable_baselines3.common.callbacks import BaseCallback  # noqa: E402
from stable_baselines3.common.vec_env import SubprocVecEnv  # noqa: E402

import ftac  # noqa: E402, F401
from ftac.scene import pose_matrix  # noqa: E402

HELD_OUT = 1_000_000
"""Seeds of the test episodes begin here."""


class Flat(gymnasium.ObservationWrapper):
    """What is measured as one vector, lengths in decimetres."""

    def __init__(self, env):
        super().__init__(env)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (31,), np.float32)

    def observation(self, observation):
        seen, palm = (pose_matrix(pose.astype(np.float64)) for pose in (observation["seen"][0], observation["palm"]))
        near = np.linalg.inv(seen) @ palm
        servos = observation["servos"][:, [0, 2]].ravel()
        parts = [10.0 * near[:3, 3], near[:3, :3].ravel(), 10.0 * palm[2:3, 3], servos, observation["command"]]
        return np.concatenate(parts).astype(np.float32)


def make(combination):
    return Flat(gymnasium.make("ftac/PickOne-v0", combination=combination, reward="shaped"))


class Curve(BaseCallback):
    """Tests the policy at the beginning and every `every` steps, and stops when the time is up."""

    def __init__(self, args):
        super().__init__()
        self.args, self.begun, self.next = args, time.monotonic(), 0
        self.env = make(args.combination)

    def _on_step(self):
        minutes = (time.monotonic() - self.begun) / 60.0
        over = minutes >= self.args.minutes
        if self.num_timesteps >= self.next or over:
            self.next = self.num_timesteps + self.args.every
            self.test(minutes)
        return not over

    def test(self, minutes):
        successes, returns = 0, []
        for episode in range(self.args.episodes):
            observation, _ = self.env.reset(seed=HELD_OUT + episode)
            over, total = False, 0.0
            while not over:
                action, _ = self.model.predict(observation, deterministic=True)
                observation, reward, terminated, truncated, info = self.env.step(action)
                over, total = terminated or truncated, total + float(reward)
            successes += bool(info["is_success"])
            returns.append(total)
        row = [self.num_timesteps, f"{minutes:.1f}", successes, self.args.episodes, f"{np.mean(returns):.3f}"]
        with open(self.args.out / "curve.csv", "a", newline="") as file:
            csv.writer(file).writerow(row)
        print(f"{row[0]} steps, {row[1]} min: {successes} of {row[3]} succeed, mean return {row[4]}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--combination", type=int, default=1, help="its first object is picked; see ftac.combinations()")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--envs", type=int, default=os.cpu_count())
    parser.add_argument("--every", type=int, default=20_000, help="steps between tests")
    parser.add_argument("--episodes", type=int, default=20, help="in a test")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("learning"))
    args = parser.parse_args()
    args.out.mkdir(parents=True)
    with open(args.out / "curve.csv", "w", newline="") as file:
        csv.writer(file).writerow(["steps", "minutes", "successes", "episodes", "mean_return"])
    envs = SubprocVecEnv([lambda: make(args.combination)] * args.envs, start_method="forkserver")
    steps = max(256, 2048 // args.envs)
    # A standard deviation of 0.3 of an action's range leaves the palm near where it is sent.
    policy = {"log_std_init": -1.2, "net_arch": [128, 128]}
    model = PPO("MlpPolicy", envs, seed=args.seed, n_steps=steps, batch_size=256, policy_kwargs=policy, device="cpu")
    model.learn(1_000_000_000, callback=Curve(args))
    model.save(args.out / "policy.zip")
    envs.close()


if __name__ == "__main__":
    main()
