"""Reinforcement learning (PPO) of ``ftac/PickOne-v1`` over many objects, with and without tactile images, with a critic that knows the truth.

    python reinforce.py --objects ball_45,ball_50,tennis_ball,lemon --sigma 0.3 --rate 3e-4 --episodes 64 --iterations 80 --out picked
    python reinforce.py --start imitation/plain_*.npz --out reinforced

The first command learns from nothing, in half an hour of two cores; the second improves networks of `imitate.py`, one after another. Worker processes run whole episodes with a copy of the policy;
the update runs in this process. The critic also sees ``privileged``: it is not needed when the policy is used. ``curve.csv`` has the successes and the mean return of each
iteration, in which the policy explores, ``results.csv`` the tests before and after, in which it does not. A network can be used as that of `imitate.Imitation`.
It needs numpy and gymnasium.
"""

import argparse
import csv
import os
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

os.environ.setdefault("RAYON_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import imitate  # noqa: E402
import numpy as np  # noqa: E402
from network import Network, batches  # noqa: E402

STEPS = imitate.TASKS["PickOne"].steps
"""Length of an episode."""
DISCOUNT, LAMBDA, CLIP = 0.995, 0.95, 0.2
HOLD = 4
"""Steps for which a draw of the exploration lasts: one of each step would cancel out."""


def episode(job):
    """Runs an episode with exploration of standard deviation `sigma`: inputs, critic's inputs, actions, rewards, success."""
    objects, tactile, seed, network, sigma = job
    random = np.random.default_rng(seed)
    env = imitate.make(objects, imitate.SIDE if tactile else None, imitate.Task(), reward="shaped", privileged=True)
    observation, info = env.reset(seed=seed)
    inputs, noise = imitate.Inputs(tactile), np.zeros(env.action_space.shape[0])
    rows, seen, actions, rewards = [], [], [], []
    for step in range(STEPS):
        rows.append(inputs(observation))
        seen.append(np.concatenate([rows[-1], observation["privileged"]]))
        if step % HOLD == 0:
            noise = sigma * random.standard_normal(len(noise))
        actions.append((network(rows[-1][None])[0] + noise).astype(np.float32))
        observation, reward, over, _, info = env.step(np.clip(actions[-1], -1.0, 1.0))
        rewards.append(reward)
        if over:
            break
    return np.array(rows), np.array(seen, np.float32), np.array(actions), np.array(rewards), bool(info["is_success"])


def advantages(rewards, values):
    """Generalised advantage estimates of an episode that ends with value 0."""
    ahead = np.append(values[1:], 0.0)
    deltas, total, found = rewards + DISCOUNT * ahead - values, 0.0, np.zeros(len(rewards))
    for step in range(len(rewards) - 1, -1, -1):
        total = deltas[step] + DISCOUNT * LAMBDA * total
        found[step] = total
    return found


def update(policy, inputs, actions, advantage, sigma, random, rate, passes=4, batch=1024):
    """Passes of PPO over the steps."""
    before = policy(inputs)
    chance_before = -0.5 * ((actions - before) ** 2).sum(axis=1) / sigma**2
    for _ in range(passes):
        for chosen in batches(len(inputs), batch, random):
            layers = policy.layers(inputs[chosen])
            off = actions[chosen] - layers[-1]
            ratio = np.exp(np.clip(-0.5 * (off**2).sum(axis=1) / sigma**2 - chance_before[chosen], -20.0, 20.0))
            gain = advantage[chosen]
            inside = np.where(gain > 0, ratio < 1 + CLIP, ratio > 1 - CLIP)
            slope = -(ratio * gain * inside)[:, None] * off / sigma**2 / len(chosen)
            policy.adam(policy.gradients(layers, slope.astype(np.float32)), rate)


def untrained(objects, tactile, hidden, random):
    """A network that knows the scale of the inputs, from an episode of the script."""
    rows = imitate.episode((objects[:1], tactile, imitate.Task(), (0, 0), None, None))[0]
    policy = Network(rows.shape[1], 12, hidden, random, pixels=imitate.PIXELS if tactile else 0)
    policy.standardize(rows)
    return policy


def improve(args, workers, policy, tactile, seed, objects):
    """Iterations of PPO; yields the steps, the successes and the mean return of each."""
    random, critic, begun = np.random.default_rng(seed), None, time.monotonic()
    for iteration in range(args.iterations):
        if time.monotonic() - begun > 60.0 * args.minutes:
            break
        first = (seed * args.iterations + iteration) * args.episodes
        jobs = [([objects[n % len(objects)]], tactile, first + n, policy, args.sigma) for n in range(args.episodes)]
        runs = list(workers.map(episode, jobs, chunksize=4))
        inputs, seen, actions = (np.concatenate([run[n] for run in runs]) for n in range(3))
        if critic is None:
            critic = Network(seen.shape[1], 1, args.hidden, random)
            critic.standardize(seen)
        values = np.split(critic(seen)[:, 0], np.cumsum([len(run[3]) for run in runs])[:-1])
        gains = np.concatenate([advantages(run[3], value) for run, value in zip(runs, values)])
        targets = (gains + np.concatenate(values)).astype(np.float32)[:, None]
        critic.fit(seen, targets, 4, random, batch=1024)
        # The critic of the first iteration knows nothing yet.
        if iteration > 0:
            update(policy, inputs, actions, (gains - gains.mean()) / (gains.std() + 1e-6), args.sigma, random, args.rate)
        yield len(inputs), sum(run[4] for run in runs), float(np.mean([run[3].sum() for run in runs]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--start", type=Path, nargs="+", help="networks of imitate.py; one from nothing if left out")
    parser.add_argument("--tactile", action="store_true", help="with images, where there is no --start")
    parser.add_argument("--objects", help="names with commas between; all that the repertoire has if left out")
    parser.add_argument("--iterations", type=int, default=8)
    parser.add_argument("--episodes", type=int, default=396, help="of an iteration")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="of training at most, for each network")
    parser.add_argument("--sigma", type=float, default=0.06, help="of the exploration, as a share of the largest action")
    parser.add_argument("--rate", type=float, default=1e-4)
    parser.add_argument("--seed", type=int, default=0, help="of the first network; the next ones have the following seeds")
    parser.add_argument("--tests", type=int, default=330, help="episodes in which each network is tested")
    parser.add_argument("--first-seed", type=int, default=imitate.HELD_OUT, help="of the test episodes")
    parser.add_argument("--hidden", type=int, default=256)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--out", type=Path, default=Path("reinforced"))
    args = parser.parse_args()
    if args.out.exists():
        parser.error(f"--out: found {args.out}, expected a new folder")
    args.out.mkdir(parents=True)
    objects = imitate.known_objects(args.objects)
    results = imitate.Results(args.out / "results.csv", "network", "when")
    with results, open(args.out / "curve.csv", "w", newline="") as curve, ProcessPoolExecutor(args.jobs) as workers:
        curves = csv.writer(curve)
        curves.writerow(["network", "iteration", "steps", "successes", "return"])
        for number, file in enumerate(args.start or [None]):
            seed, name, tactile = args.seed + number, "policy", args.tactile
            if file:
                data = np.load(file)
                name, policy, tactile = file.stem, Network.load(data), bool(data["tactile"])
            else:
                policy = untrained(objects, tactile, args.hidden, np.random.default_rng(seed))

            def test(when):
                jobs = [([objects[n % len(objects)]], tactile, args.first_seed + n, policy, 0.0) for n in range(args.tests)]
                won = [run[-1] for run in workers.map(episode, jobs, chunksize=4)]
                results.add(f"{name}, {when}", won, name, when)

            test("before")
            for iteration, (steps, won, mean) in enumerate(improve(args, workers, policy, tactile, seed, objects)):
                curves.writerow([name, iteration, steps, won, f"{mean:.3f}"])
                curve.flush()
                print(f"  {iteration + 1}: {won} of {args.episodes} succeed while it explores, return {mean:.3f}", flush=True)
            policy.save(args.out / f"{name}.npz", tactile=tactile, before=imitate.BEFORE)
            test("after")


if __name__ == "__main__":
    main()
