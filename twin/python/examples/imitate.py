"""Imitation of the scripted pick-up in ``ftac/PickOne-v1`` over many objects, or of sorting in ``ftac/Sort-v1``, with and without
tactile images (DAgger).

    python imitate.py --episodes 330 --rounds 5 --seeds 5 --tests 330 --out imitation
    python imitate.py --task SortInHand --episodes 150 --rounds 4 --seeds 5 --tests 100 --out sorting

Every round runs episodes in which the network moves the robot (in the first rounds the script does for part of the time), and the script says in every step what it would do;
a network is then fitted to all steps so far (its squared error is told as a share of the actions' variance). Without the later rounds a clone never sees the states into which its own errors lead. The file of
each network can be used as a policy of the benchmark and in the environment: class `Imitation` in this file.

The network sees the observations of `ftac.features`, with the planned grasp, now and some steps ago: the script goes by a clock. It needs numpy and gymnasium.
"""

import argparse
import csv
import functools
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("RAYON_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gymnasium  # noqa: E402
import numpy as np  # noqa: E402
from network import Network  # noqa: E402

import ftac  # noqa: E402
from ftac.features import Spec  # noqa: E402
from ftac.scripted import CARRY, Script  # noqa: E402
from ftac.sorting import ANY_SIZE  # noqa: E402

SPEC = Spec(grasp=True)
SIDE = 16
"""Of the tactile images, pixels."""
CELLS = 4
"""Side of a pad's picture as the network gets it."""
PIXELS = 17 * CELLS * CELLS * 3
"""Numbers of the pictures of all pads, the last inputs of a network."""
GAIN = 2.0
"""Scale of the changes, which are a few grey levels in the mean of a cell."""
BEFORE = (3, 8, 22)
"""Steps of 1/20 s ago of which a network sees servos, palm and set-points too; the hand closes in 22."""
HELP = (1.0, 0.6, 0.3)
"""Share of the time in which the script moves the robot in the first rounds, later not at all: so that early rounds see late stages too."""
PUSH, PUSH_STEPS = 0.1, 6
"""Standard deviation of pushes in training, as a share of the greatest velocity, and how many steps each lasts."""


class Setting(NamedTuple):
    """Environment of a task, its options, the length of an episode (steps), fields that are drawn, and `BEFORE`, `HELP` and `PUSH` for it."""

    env: str
    options: dict[str, object]
    steps: int
    randomization: dict[str, float] = {}
    before: tuple[int, ...] = BEFORE
    help: tuple[float, ...] = HELP
    push: float = PUSH


IN_HAND = "SortInHand"
"""The task whose episodes take longer to begin than to run: all rounds of a network begin in the same states. It has one stage, in which the past is of no use,
and an object that was pushed is not still."""
TASKS = {
    "PickOne": Setting("ftac/PickOne-v1", {}, 260),
    "Sort": Setting("ftac/Sort-v1", {}, 300, ANY_SIZE),
    IN_HAND: Setting("ftac/Sort-v1", {"in_hand": True, "hand": "tensions"}, 120, ANY_SIZE, before=(), help=(1.0, 0.5), push=0.03),
}
HELP_STEPS = 20
"""Steps after which it is drawn anew who moves the robot, and to which bin the script does: were it always the right one, a network would learn to go on as it goes
instead of what it feels."""
HELD_OUT = 1_000_000
"""Seeds of the test episodes begin here, unless others are asked for."""


def make(objects, images, task, **options):
    """The environment of a task, with tactile images of so many pixels a side, or None."""
    options |= {"images": images, "tactile": "change"}
    setting = TASKS[task.name]
    options["randomization"] = {**setting.randomization, **({} if task.xy_sigma is None else {"noise.perception.xy_sigma": task.xy_sigma})}
    if task.name == "PickOne":
        options["objects"] = objects
    return gymnasium.make(setting.env, grasp=True, **{**setting.options, **options}).unwrapped


class Task(NamedTuple):
    """The name of the task, what the teacher knows of the object's pose, and the standard deviation of the detected position (m): a value,
    a range of which every episode draws one, or None for the benchmark's."""

    name: str = "PickOne"
    teacher: str = "detected"
    xy_sigma: float | tuple[float, float] | None = None


def scripts_of(env, task):
    """A script for each place to which the object can be carried, and the number of the one that is right. If the teacher knows the true pose, they go to where the object really is."""
    pose = env.save().episode.true_state()["objects"][0] if task.teacher == "truth" else None
    if task.name == "PickOne":
        return [Script(env.features, pose=pose)], 0
    stage = CARRY if task.name == IN_HAND else 0
    return [Script(env.features, pose=pose, place=place, stage=stage) for place in env.bins], env.class_of_object


class Inputs:
    """Rows of inputs from the observations of an episode."""

    def __init__(self, tactile, before=BEFORE):
        self.tactile, self.before, self.past = tactile, before, []

    def __call__(self, observation):
        moving = np.concatenate([observation[name].ravel() for name in ("servos", "palm", "command")])
        self.past.append(moving)
        # Of several objects, the first is to be picked.
        parts = [observation[name][:1].ravel() for name in ("objects", "shape", "grasp")]
        parts += [observation["arm"].ravel(), observation["time"], moving]
        parts += [self.past[max(0, len(self.past) - 1 - before)] for before in self.before]
        if self.tactile:
            change = (observation["tactile"].astype(np.float32) - 128.0) / 128.0
            cells = change.reshape(len(change), CELLS, SIDE // CELLS, CELLS, SIDE // CELLS, 3).mean(axis=(2, 4)).ravel()
            parts.append(GAIN * cells)
        return np.concatenate(parts).astype(np.float32)


class Imitation:
    """A trained network as a policy, which picks the first object: ``ftac bench --policy imitate.py:Imitation --policy-arg weights=policy.npz``."""

    def __init__(self, weights):
        data = np.load(weights)
        self.network, self.tactile, self.before = Network.load(data), bool(data["tactile"]), data["before"]
        self.features = Spec(grasp=True, images=SIDE, tactile="change") if self.tactile else SPEC

    def reset(self, info):
        self.inputs = Inputs(self.tactile, self.before)

    def act(self, observation):
        return np.clip(self.network(self.inputs(observation)[None])[0], -1.0, 1.0)


@functools.cache
def environment_in_hand(tactile, task):
    return make(None, SIDE if tactile else None, task)


@functools.cache
def start_in_hand(tactile, task, seed):
    """The state in which the episode with this seed begins, kept for later rounds."""
    env = environment_in_hand(tactile, task)
    env.reset(seed=seed)
    return env.save()


def begin(objects, tactile, task, seed):
    """An environment at the beginning of the episode with this seed, and the first observation."""
    if task.name == IN_HAND:
        env = environment_in_hand(tactile, task)
        return env, env.restore(start_in_hand(tactile, task, seed))
    env = make(objects, SIDE if tactile else None, task)
    return env, env.reset(seed=seed)[0]


def episode(job):
    """Runs an episode: rows of inputs, what the script would do (nothing in a test of a network), and whether the task was done in the end. `help` is the share of the time in which a script
    moves the robot in training, or None in a test: of the network, or of the script if there is none."""
    objects, tactile, task, (seed, number), network, help = job
    random = np.random.default_rng([seed, number])
    env, observation = begin(objects, tactile, task, seed)
    setting = TASKS[task.name]
    (scripts, right), inputs = scripts_of(env, task), Inputs(tactile, setting.before)
    rows, actions, pushed = [], [], np.zeros(env.action_space.shape[0])
    # Nobody asks the scripts in a test of a network.
    asked = scripts if network is None or help is not None else []
    for step in range(setting.steps):
        rows.append(inputs(observation))
        proposed = [script.act(observation) for script in asked]
        actions += proposed[right : right + 1]
        if step % HELP_STEPS == 0:
            helped = network is None or (help is not None and random.random() < help)
            chosen = right if help is None else int(random.integers(len(scripts)))
        action = proposed[chosen] if helped else network(rows[-1][None])[0]
        if step % PUSH_STEPS == 0:
            pushed[:6] = 0.0 if help is None else setting.push * random.standard_normal(6)
        observation, _, over, _, info = env.step(np.clip(action + pushed, -1.0, 1.0))
        if over:
            break
    return np.array(rows), np.array(actions, dtype=np.float32), bool(info["is_success"])


def interval(count, of, z=1.96):
    """95 % interval of a share (Wilson)."""
    share, spread = count / of, z * z / of
    middle, half = share + spread / 2, z * np.sqrt(share * (1 - share) / of + spread / (4 * of))
    low, high = (middle - half) / (1 + spread), (middle + half) / (1 + spread)
    return f"{count} of {of}, {share:.3f} ({max(0.0, low):.3f} to {min(1.0, high):.3f})"


class Results:
    """Tests of policies: a table in a file, with the outcome of every episode, and a line for each on the terminal."""

    def __init__(self, path, *columns):
        self.file = open(path, "w", newline="")
        self.table = csv.writer(self.file)
        self.table.writerow([*columns, "successes", "episodes", "outcomes"])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.file.close()

    def add(self, words, won, *values):
        """Adds a test whose episodes were `won` or not; `values` are those of the columns."""
        self.table.writerow([*values, sum(won), len(won), "".join("01"[one] for one in won)])
        self.file.flush()
        print(f"{words}: {interval(sum(won), len(won))}", flush=True)


def known_objects(asked):
    """All objects, or those asked for."""
    return ftac.objects() if asked is None else asked.split(",")


def train(args, workers, tactile, seed, objects):
    """Trains a network; returns it and the share of successes in each round."""
    random, setting = np.random.default_rng(seed), TASKS[args.task.name]
    data, network, curve = [], None, []
    for number in range(args.rounds):
        first = (seed * args.rounds + number * (args.task.name != IN_HAND)) * args.episodes
        help = setting.help[number] if number < len(setting.help) else 0.0
        jobs = [([objects[n % len(objects)]], tactile, args.task, (first + n, number), network, help) for n in range(args.episodes)]
        runs = list(workers.map(episode, jobs, chunksize=4))
        # Where a script alone has moved the robot it is a teacher only if it succeeds; it knows what to do wherever it was led.
        data += [(rows, actions) for rows, actions, success in runs if success or network is not None or args.task.name != "PickOne"]
        inputs, outputs = (np.concatenate(parts) for parts in zip(*data))
        if network is None:
            network = Network(inputs.shape[1], outputs.shape[1], args.hidden, random, pixels=PIXELS if tactile else 0)
        network.standardize(inputs)
        fit = network.fit_on_gpu if args.gpu else network.fit
        error = fit(inputs, outputs, args.epochs, random) / outputs.var(axis=0).mean()
        curve.append(sum(success for *_, success in runs) / len(runs))
        print(f"  round {number + 1}: {curve[-1]:.3f} of {len(runs)} episodes succeed, {len(inputs)} steps, error {error:.4f}", flush=True)
    return network, curve


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", dest="task_name", choices=list(TASKS), default="PickOne")
    parser.add_argument("--objects", help="of PickOne: names with commas between; all that the repertoire has if left out")
    parser.add_argument("--episodes", type=int, default=330, help="of a round")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seeds", type=int, default=5, help="networks of each kind")
    parser.add_argument("--tests", type=int, default=330, help="episodes in which each network is tested")
    parser.add_argument("--first-seed", type=int, default=HELD_OUT, help="of the test episodes")
    parser.add_argument("--kinds", default="script,plain,tactile", help="of policies: script, network without images, with images")
    parser.add_argument("--teacher", choices=["detected", "truth"], default="detected", help="pose to which the script goes")
    parser.add_argument(
        "--xy-sigma", type=float, nargs=2, metavar=("LOW", "HIGH"), help="range of the standard deviation of the detected position in training, m"
    )
    parser.add_argument("--test-sigma", type=float, nargs="*", default=[], help="standard deviations of further tests, m")
    parser.add_argument("--first-network", type=int, default=0, help="number of the first network")
    parser.add_argument("--gpu", action="store_true", help="fit with torch on a GPU")
    parser.add_argument("--epochs", type=int, default=20)
    parser.add_argument("--hidden", type=int, default=256)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--out", type=Path, default=Path("imitation"))
    args = parser.parse_args()
    if args.out.exists():
        parser.error(f"--out: found {args.out}, expected a new folder")
    args.out.mkdir(parents=True)
    args.task = Task(args.task_name, args.teacher, args.xy_sigma and tuple(args.xy_sigma))
    objects = known_objects(args.objects)
    with Results(args.out / "results.csv", "policy", "seed", "xy_sigma", "rounds") as results, ProcessPoolExecutor(args.jobs) as workers:

        def test(name, tactile, seed, network, curve, teacher=args.teacher):
            for sigma in [None, *args.test_sigma]:
                task = Task(args.task_name, teacher, sigma)
                jobs = [([objects[n % len(objects)]], tactile, task, (args.first_seed + n, 0), network, None) for n in range(args.tests)]
                won = [success for *_, success in workers.map(episode, jobs, chunksize=4)]
                where = "the benchmark's errors" if sigma is None else f"detection error {1e3 * sigma:g} mm"
                rounds = " ".join(f"{share:.3f}" for share in curve)
                results.add(f"{name}, seed {seed}, {where}", won, name, seed, "" if sigma is None else sigma, rounds)

        if "script" in args.kinds:
            if args.task_name == "PickOne":
                test("script", False, "", None, [], "detected")
                test("script that knows the truth", False, "", None, [], "truth")
            else:
                test("script that knows the class", False, "", None, [])
        for seed in range(args.first_network, args.first_network + args.seeds):
            for kind in (kind for kind in args.kinds.split(",") if kind != "script"):
                network, curve = train(args, workers, kind == "tactile", seed, objects)
                network.save(args.out / f"{kind}_{seed}.npz", tactile=kind == "tactile", before=TASKS[args.task_name].before)
                test(kind, kind == "tactile", seed, network, curve)


if __name__ == "__main__":
    main()
