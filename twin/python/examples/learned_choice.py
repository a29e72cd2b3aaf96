"""A policy that has learned which grasp takes the second object: from trials of the benchmark in which the choice was drawn at random.

    python learned_choice.py --out choice.npz
    ftac bench --policy learned_choice.py:LearnedChoice --policy-arg weights=choice.npz

In every trial of the training one candidate is tried once. A network is fitted to whether the trial was a clean success, from what the policy knew when it
chose: plan, detected poses, and where touch says the first object is in the hand. The policy takes the candidate with the best prediction, and after a
failed try the best of the others. It needs numpy.
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

os.environ.setdefault("RAYON_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np  # noqa: E402
from network import Network  # noqa: E402

import ftac  # noqa: E402
from ftac import bench  # noqa: E402
from ftac.grasps import palm_goal  # noqa: E402

NAMES = ftac.objects()
DIGITS = ("thumb", "index", "middle", "ring", "little")
PLANNED_FIRST = 0.3
"""Share of the training's trials that take the planned candidate, whatever the number of the others."""
TRIES = 3
"""At one object."""


def rows_of(situation):
    """A row of inputs for each candidate: lengths in 0.1 m, tensions in 100 N, angles in rad; the first object's turn as a quaternion's x, y, z."""
    # Where the first object is in the hand: as felt, or else as planned.
    unfelt, planned = situation.in_hand is None, situation.first.center
    felt, turned = (planned, np.zeros(3)) if unfelt else (situation.in_hand[:3], situation.in_hand[3:6])
    spread = np.zeros(6) if situation.in_hand_covariance is None else np.sqrt(np.diag(situation.in_hand_covariance))
    objects = np.array([[name == known for known in NAMES] for name in situation.objects], dtype=float)
    shared = [
        *objects.ravel(),
        *(10.0 * felt),
        *(10.0 * (felt - planned)),
        *turned,
        *(10.0 * spread[:3]),
        *spread[3:],
        float(unfelt),
        float(situation.holding[0]),
        10.0 * situation.detected[1, 2],
    ]
    rows = []
    for candidate, score in zip(situation.candidates, situation.scores):
        goal = palm_goal(candidate, situation.detected[1], situation.yaws[1])
        first = goal[:3, :3] @ felt + goal[:3, 3]
        apart = goal[:3, :3].T @ (first - situation.detected[1, :3])
        rows.append(
            [
                *shared,
                score,
                np.log((score + 0.02) / (1.02 - score)),
                candidate.pitch,
                candidate.roll,
                np.cos(candidate.yaw),
                np.sin(candidate.yaw),
                *(10.0 * candidate.center),
                *(0.01 * candidate.close_tension),
                candidate.opposition,
                10.0 * candidate.raise_,
                *(name in candidate.digits for name in DIGITS),
                # The first object when the digits close on the second: its height, and where it is beside the second.
                10.0 * first[2],
                *(10.0 * apart),
                10.0 * np.linalg.norm(apart),
            ]
        )
    return np.array(rows, dtype=np.float32)


class Explorer:
    """Tries one candidate, drawn at random, and keeps what was known of it, by number of the trial."""

    def __init__(self):
        self.rows = {}

    def reset(self, info):
        self.random, self.trial = np.random.default_rng(info["seed"]), info["trial"]

    def choose(self, situation):
        if situation.phase != "decide":
            return None
        drawn = self.random.random() >= PLANNED_FIRST
        place = int(self.random.integers(len(situation.candidates))) if drawn else 0
        self.rows[self.trial] = rows_of(situation)[place]
        return place


def explore(job):
    """Inputs and clean successes of the trials of a combination in which there was a choice."""
    combination, trials, seed = job
    policy = Explorer()
    rows = bench.run(policy, combinations=[combination], trials=trials, seed=seed)
    return [(combination, seed, policy.rows[row["trial"]], row["clean_success"]) for row in rows if row["trial"] in policy.rows]


class LearnedChoice:
    """Takes the candidate with the best prediction of a trained network."""

    def __init__(self, weights):
        self.network = Network.load(np.load(weights))

    def reset(self, info):
        self.tried = set()

    def choose(self, situation):
        if situation.phase != "decide" and (situation.holding[1] or situation.tries >= TRIES):
            return None
        predicted = self.network(rows_of(situation))[:, 0]
        predicted[list(self.tried)] -= 1.0
        place = int(np.argmax(predicted))
        self.tried.add(place)
        return place


def fitted(inputs, clean, epochs, hidden, random):
    """A network that predicts the clean successes."""
    network = Network(inputs.shape[1], 1, hidden, random)
    network.standardize(inputs)
    network.weights[-1][:] = clean.mean()
    network.fit(inputs, clean[:, None].astype(np.float32), epochs, random, batch=128)
    return network


def unseen_predictions(inputs, clean, folds, epochs, hidden):
    """Predictions for every trial by a network that was fitted without its fold."""
    predicted = np.zeros(len(clean))
    for fold in np.unique(folds):
        network = fitted(inputs[folds != fold], clean[folds != fold], epochs, hidden, np.random.default_rng(fold))
        predicted[folds == fold] = network(inputs[folds == fold])[:, 0]
    return predicted


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--combinations", type=int, nargs="*", default=list(range(len(ftac.combinations()))))
    parser.add_argument("--trials", type=int, default=10, help="of a combination under one seed")
    parser.add_argument("--seeds", type=int, nargs="+", default=[2], help="of the benchmark")
    parser.add_argument("--epochs", type=int, default=20)
    parser.add_argument("--hidden", type=int, default=16)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--out", type=Path, default=Path("choice.npz"))
    args = parser.parse_args()
    if not args.out.parent.is_dir():
        parser.error(f"--out: no folder {args.out.parent}")
    jobs = [(combination, args.trials, seed) for seed in args.seeds for combination in args.combinations]
    found = []
    with ProcessPoolExecutor(args.jobs) as workers:
        for job, rows in zip(jobs, workers.map(explore, jobs)):
            found += rows
            print(f"seed {job[2]}, combination {job[0]}: {sum(row[3] for row in rows)} of {len(rows)} choices end clean", flush=True)
    inputs, clean = np.array([row[2] for row in found]), np.array([row[3] for row in found], dtype=float)
    # The choices of a combination under one seed stay together: no network has seen what it predicts here.
    folds = np.array([(row[0] + 7 * row[1]) % 5 for row in found])
    predicted = unseen_predictions(inputs, clean, folds, args.epochs, args.hidden)
    error, mean = ((predicted - clean) ** 2).mean(), clean.var()
    print(f"{len(clean)} choices, {clean.mean():.3f} clean; error of unseen choices {error:.4f}, that of the mean {mean:.4f}")
    if error >= mean:
        raise SystemExit("the predictions are no better than the mean: nothing is saved; more trials are needed")
    fitted(inputs, clean, args.epochs, args.hidden, np.random.default_rng(0)).save(args.out)


if __name__ == "__main__":
    main()
