"""Reinforcement learning of ``ftac/PickOne-v0`` for one object with Stable-Baselines3 (SAC): a policy that corrects the scripted pick-up.

    python learn_pick_one.py --combination 3 --episodes 160 --random 40 --out learning

The script (`ftac.scripted`) carries out the repertoire's pick-up and never looks whether that helps. The policy is asked twice an episode: at the beginning,
where to aim beside what vision saw; and over the object, before the hand closes, how. It sees what is measured then. The reward is the environment's shaped
one. Policy and script alone are tested in the same episodes, before anything is learned and after it; ``curve.csv`` has the episodes of training, and
``policy.zip`` the policy. It needs stable-baselines3 beside ftac.
"""

import argparse
import csv
import os
import time
from pathlib import Path

os.environ.setdefault("RAYON_NUM_THREADS", "1")

import gymnasium  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from stable_baselines3 import SAC  # noqa: E402
from stable_baselines3.common.callbacks import BaseCallback  # noqa: E402

import ftac  # noqa: E402
from ftac.scene import pose_matrix  # noqa: E402
from ftac.scripted import Script  # noqa: E402

HELD_OUT = 1_000_000
"""Seeds of the test episodes begin here, unless others are asked for."""
AIM = np.array([0.015, 0.015, 0.015, 0.2])
"""Largest correction of the aim: along the palm's axes (m) and about the vertical (rad)."""
CLOSING = np.array([0.5, 0.5, 0.25, 0.02])
"""Largest correction of the closing: shares of the thumb's and the fingers' tensions, the thumb's delay (s), how far the palm rises meanwhile (m)."""
SIGHT = np.array([0.62, 0.0])
"""Where objects stand about, m."""
HELD = 60
"""Steps for which the script lifts and holds before an episode is given up."""


class Corrected(gymnasium.Env):
    """The scripted pick-up in two decisions of four numbers from -1 to 1: shares of `AIM`, then of `CLOSING`. Zeros leave the script as it is.

    Observations (28,): which decision it is; where the object was seen and how it is turned; the last decision; the palm against where it should be; the arm's
    torques; angles and currents of the servos.
    """

    def __init__(self, combination):
        self.env = gymnasium.make("ftac/PickOne-v0", combination=combination, reward="shaped").unwrapped
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-10.0, 10.0, (28,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.seen, self.info = self.env.reset(seed=seed)
        self.script, self.decided = None, np.zeros(4)
        return self.observed(), {}

    def step(self, action):
        action = np.asarray(action, dtype=np.float64)
        first = self.script is None
        if first:
            self.aim(AIM * action)
        else:
            thumb, fingers, delay, rise = CLOSING * action
            grasp = self.script.grasp
            tensions = np.clip(grasp.close_tension * (1.0 + np.array([thumb, *[fingers] * 4])), 0.0, self.env.TENSION)
            self.script.grasp = grasp._replace(close_tension=tensions, thumb_delay=grasp.thumb_delay + delay)
            for goal in self.script.goals[2:]:
                goal[2] += rise
        self.decided = action
        reward, over = self.play(2 if first else 4)
        return self.observed(), reward, over or not first, False, self.won

    def aim(self, correction):
        """A script that aims beside what was seen."""
        name = self.info["objects"][0]
        grasp, yaw = ftac.grasps.repertoire()[name][0], self.info["yaws"][0]
        self.script = Script(self.env, grasp, self.seen["detected"][0], yaw + correction[3])
        shift = self.script.rotation @ correction[:3]
        for goal in self.script.goals:
            goal += shift

    def play(self, stage):
        """Goes on until the script comes to a stage; what it gained, and whether the episode is over."""
        total, held = 0.0, 0
        while self.script.stage < stage and held < HELD:
            self.seen, reward, over, _, self.won = self.env.step(self.script.act(self.seen))
            total += float(reward)
            held += self.script.stage == 3
            if over:
                return total, True
        return total, False

    def observed(self):
        seen = pose_matrix(self.seen["detected"][0].astype(np.float64))
        palm = pose_matrix(self.seen["palm"].astype(np.float64))
        yaw, off = self.info["yaws"][0], np.zeros(3)
        if self.script is not None:
            off = self.script.rotation.T @ (palm[:3, 3] - self.script.goals[1]) / 0.01
        servos = self.seen["servos"][:, [0, 2]].ravel()
        arm = self.seen["arm"][:4, 2] / 10.0
        where = 10.0 * (seen[:2, 3] - SIGHT)
        parts = [[float(self.script is not None)], where, [np.sin(yaw), np.cos(yaw)], self.decided, off, arm, servos]
        return np.clip(np.concatenate(parts), -10.0, 10.0).astype(np.float32)


def test(env, seeds, decide):
    """Whether each episode succeeds, and its return."""
    successes, returns = [], []
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        over, total = False, 0.0
        while not over:
            observation, reward, over, _, info = env.step(decide(observation))
            total += reward
        successes.append(bool(info["is_success"]))
        returns.append(total)
    return np.array(successes), np.array(returns)


def interval(count, of, z=1.96):
    """95 % interval of a share (Wilson)."""
    share, spread = count / of, z * z / of
    middle, half = share + spread / 2, z * np.sqrt(share * (1 - share) / of + spread / (4 * of))
    return f"{max(0.0, (middle - half) / (1 + spread)):.2f} to {min(1.0, (middle + half) / (1 + spread)):.2f}"


def tell(name, successes, returns):
    count, of = int(successes.sum()), len(successes)
    print(f"{name}: {count} of {of} succeed ({interval(count, of)}), mean return {returns.mean():.3f}", flush=True)


class Curve(BaseCallback):
    """Writes a row an episode of training, and stops after as many as are asked for."""

    def __init__(self, args):
        super().__init__()
        self.args, self.begun, self.total, self.rows = args, time.monotonic(), 0.0, []

    def _on_step(self):
        self.total += float(self.locals["rewards"][0])
        if self.locals["dones"][0]:
            success = bool(self.locals["infos"][0]["is_success"])
            self.rows.append([len(self.rows) + 1, f"{time.monotonic() - self.begun:.0f}", int(success), f"{self.total:.3f}"])
            self.total = 0.0
            with open(self.args.out / "curve.csv", "a", newline="") as file:
                csv.writer(file).writerow(self.rows[-1])
            if len(self.rows) % 50 == 0:
                last = self.rows[-50:]
                won, mean = sum(row[2] for row in last), np.mean([float(row[3]) for row in last])
                print(f"{len(self.rows)} episodes, {last[-1][1]} s: {won} of the last 50, return {mean:.3f}", flush=True)
        return len(self.rows) < self.args.episodes


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--combination", type=int, default=3, help="its first object is picked; see ftac.combinations()")
    parser.add_argument("--episodes", type=int, default=160, help="of training")
    parser.add_argument("--random", type=int, default=40, help="episodes at the beginning with decisions at random")
    parser.add_argument("--tests", type=int, default=100, help="episodes of each test")
    parser.add_argument("--first-seed", type=int, default=HELD_OUT, help="of the test episodes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("learning"))
    args = parser.parse_args()
    args.out.mkdir(parents=True)
    torch.set_num_threads(1)
    with open(args.out / "curve.csv", "w", newline="") as file:
        csv.writer(file).writerow(["episode", "seconds", "success", "return"])
    env, tests = Corrected(args.combination), Corrected(args.combination)
    seeds = [args.first_seed + n for n in range(args.tests)]
    before, returns = test(tests, seeds, lambda observation: np.zeros(4))
    tell("the script alone", before, returns)
    options = {"learning_rate": 1e-3, "batch_size": 128, "gamma": 1.0, "ent_coef": "auto_0.1", "gradient_steps": 4}
    model = SAC(
        "MlpPolicy", env, seed=args.seed, device="cpu", learning_starts=2 * args.random, policy_kwargs={"net_arch": [64, 64]}, **options
    )
    model.learn(1_000_000_000, callback=Curve(args))
    model.save(args.out / "policy.zip")
    after, returns = test(tests, seeds, lambda observation: model.predict(observation, deterministic=True)[0])
    tell("the corrected script", after, returns)
    print(f"only the script: {int((before & ~after).sum())} episodes, only the policy: {int((after & ~before).sum())}")


if __name__ == "__main__":
    main()
