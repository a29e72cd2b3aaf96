"""Reinforcement learning (PPO) of ``ftac/PickOne-v1`` over many objects, with and without tactile images, with a critic that knows the truth.

    python reinforce.py --start imitation/plain_0.npz --iterations 30 --episodes 264 --out reinforced

Worker processes run whole episodes with a copy of the policy; the update runs in this process. The policy begins as a network of `imitate.py`, or from nothing without
``--start``. The critic also sees ``privileged``: it is not needed when the policy is used. ``curve.csv`` has the successes and the mean return of each iteration;
``policy.npz`` can be used as that of `imitate.Imitation`. It needs numpy and gymnasium.
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
from network import Network  # noqa: E402

STEPS = 260
"""Length of an episode, steps."""
DISCOUNT, LAMBDA, CLIP = 0.995, 0.95, 0.2
HOLD = 4
"""Steps for which a draw of the exploration lasts: one of each step would cancel out."""


def episode(job):
    """Runs an episode with exploration of standard deviation `sigma`: inputs, critic's inputs, actions, rewards, success."""
    objects, tactile, seed, network, sigma = job
    random = np.random.default_rng(seed)
    env = imitate.make(objects, tactile, imitate.Task(), reward="shaped", privileged=True)
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


def update(policy, inputs, actions, advantage, sigma, random, rate, passes=4, batch=4096):
    """Passes of PPO over the steps."""
    before = policy(inputs)
    chance_before = -0.5 * ((actions - before) ** 2).sum(axis=1) / sigma**2
    for _ in range(passes):
        order = random.permutation(len(inputs))
        for start in range(0, len(order), batch):
            chosen = order[start : start + batch]
            layers = policy.layers(inputs[chosen])
            off = actions[chosen] - layers[-1]
            ratio = np.exp(np.clip(-0.5 * (off**2).sum(axis=1) / sigma**2 - chance_before[chosen], -20.0, 20.0))
            gain = advantage[chosen]
            inside = np.where(gain > 0, ratio < 1 + CLIP, ratio > 1 - CLIP)
            slope = -(ratio * gain * inside)[:, None] * off / sigma**2 / len(chosen)
            policy.adam(policy.gradients(layers, slope.astype(np.float32)), rate)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--start", type=Path, help="a network of imitate.py; from nothing if left out")
    parser.add_argument("--tactile", action="store_true", help="with images, where there is no --start")
    parser.add_argument("--objects", help="names with commas between; all that the repertoire has if left out")
    parser.add_argument("--iterations", type=int, default=30)
    parser.add_argument("--episodes", type=int, default=264, help="of an iteration")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="of training at most")
    parser.add_argument("--sigma", type=float, default=0.1, help="of the exploration, as a share of the largest action")
    parser.add_argument("--rate", type=float, default=1e-4)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tests", type=int, default=330)
    parser.add_argument("--first-seed", type=int, default=imitate.HELD_OUT, help="of the test episodes")
    parser.add_argument("--hidden", type=int, default=256)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--out", type=Path, default=Path("reinforced"))
    args = parser.parse_args()
    if args.out.exists():
        parser.error(f"--out: found {args.out}, expected a new folder")
    args.out.mkdir(parents=True)
    random, objects, begun = np.random.default_rng(args.seed), imitate.known_objects(args.objects), time.monotonic()
    tactile, policy, critic = args.tactile, None, None
    if args.start:
        data = np.load(args.start)
        policy, tactile = Network.load(data), bool(data["tactile"])
    with open(args.out / "curve.csv", "w", newline="") as file, ProcessPoolExecutor(args.jobs) as workers:
        table = csv.writer(file)
        table.writerow(["iteration", "episodes", "steps", "successes", "return"])

        def test(name):
            jobs = [([objects[n % len(objects)]], tactile, args.first_seed + n, policy, 0.0) for n in range(args.tests)]
            won = [run[-1] for run in workers.map(episode, jobs, chunksize=4)]
            print(f"{name}: {imitate.interval(sum(won), len(won))}", flush=True)

        if policy is None:
            rows = workers.submit(imitate.episode, ([objects[0]], tactile, imitate.Task(), (0, 0), None, None)).result()[0]
            policy = Network(rows.shape[1], 12, args.hidden, random, pixels=imitate.PIXELS if tactile else 0)
            policy.standardize(rows)
        test("before")
        for iteration in range(args.iterations):
            if time.monotonic() - begun > 60.0 * args.minutes:
                break
            first = (args.seed * args.iterations + iteration) * args.episodes
            jobs = [
                ([objects[n % len(objects)]], tactile, first + n, policy, args.sigma) for n in range(args.episodes)
            ]
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
            won = sum(run[4] for run in runs)
            mean = float(np.mean([run[3].sum() for run in runs]))
            table.writerow([iteration, (iteration + 1) * len(runs), len(inputs), won, f"{mean:.3f}"])
            file.flush()
            print(f"{iteration + 1}: {won} of {len(runs)} succeed, return {mean:.3f}, {time.monotonic() - begun:.0f} s", flush=True)
        policy.save(args.out / "policy.npz", tactile=tactile, before=imitate.BEFORE)
        test("after")


if __name__ == "__main__":
    main()
