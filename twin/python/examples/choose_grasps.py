"""Which pick-up of the repertoire the script carries out best in ``ftac/PickOne-v1``, object by object: what `ftac.grasps.pick_one` returns.

    python choose_grasps.py --out pick_one.json

Every candidate is tried in some episodes, the better half in twice as many, and so on (successive halving). An object without grasps in the repertoire is
tried with two of every other one, or with all of those that `--like` names. Errors and effects are the benchmark's. It needs numpy and gymnasium.
"""

import argparse
import json
import os
import time
from concurrent.futures import ProcessPoolExecutor

os.environ.setdefault("RAYON_NUM_THREADS", "1")

import ftac  # noqa: E402
from ftac import envs  # noqa: E402
from ftac.scripted import Script  # noqa: E402

STEPS = 260
"""Length of an episode, steps."""


def held(job):
    """Whether the script holds the object with this grasp in the episode of a seed."""
    name, (owner, number), seed = job
    env = envs.Pick(objects=[name])
    observation, info = env.reset(seed=seed)
    script = Script(env.features, ftac.grasps.numbered(owner, number), yaw=info["yaws"][0])
    for _ in range(STEPS):
        observation, _, over, _, info = env.step(script.act(observation))
        if over:
            break
    return bool(info["is_success"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", help="names with commas between; all if left out")
    parser.add_argument("--like", help="objects whose grasps are tried as well, names with commas between")
    parser.add_argument("--episodes", type=int, default=4, help="of the first round")
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--most", type=int, default=1_000_000, help="candidates of an object at most")
    parser.add_argument("--first-seed", type=int, default=2_000_000)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--out", default="pick_one.json")
    args = parser.parse_args()
    known, begun = ftac.grasps.repertoire(), time.monotonic()
    names = ftac.objects() if args.objects is None else args.objects.split(",")
    left, like = {}, args.like.split(",") if args.like else []
    for name in like:
        if name not in known:
            parser.error(f"--like: found {name}, expected an object with grasps: {', '.join(known)}")
    for name in names:
        own = [grasp for of in (name, *like) for grasp in known.get(of, [])] or [grasp for grasps in known.values() for grasp in grasps[:2]]
        left[name] = {(grasp.object, grasp.id): [0, 0] for grasp in own[: args.most]}
    with ProcessPoolExecutor(args.jobs) as workers:
        for number in range(args.rounds):
            episodes = args.episodes << number
            # Each round has episodes of its own: the luck of one is not carried into the next.
            first = args.first_seed + number * 100_000
            jobs = [(name, grasp, first + n) for name, tried in left.items() for grasp in tried for n in range(episodes)]
            for (name, grasp, _), success in zip(jobs, workers.map(held, jobs, chunksize=8)):
                left[name][grasp][0] += success
                left[name][grasp][1] += 1
            print(f"round {number + 1}: {len(jobs)} episodes, {time.monotonic() - begun:.0f} s", flush=True)
            if number + 1 < args.rounds:
                for name, tried in left.items():
                    best = sorted(tried, key=lambda grasp: -tried[grasp][0] / tried[grasp][1])
                    left[name] = {grasp: tried[grasp] for grasp in best[: max(2, (len(best) + 1) // 2)]}
    chosen = {}
    for name, tried in left.items():
        best = max(tried, key=lambda grasp: tried[grasp][0] / tried[grasp][1])
        chosen[name] = {"object": best[0], "id": best[1], "held": tried[best][0], "of": tried[best][1]}
        print(f"{name:15} {best[0]} {best[1]:4}: held in {tried[best][0]} of {tried[best][1]}", flush=True)
    with open(args.out + ".partial", "w") as file:
        json.dump(chosen, file, indent=1)
    os.replace(args.out + ".partial", args.out)


if __name__ == "__main__":
    main()
