"""Behaviour cloning of the scripted pick-up for ``ftac/PickOne-v0``, with and without tactile images.

    python clone_pick_one.py collect --episodes 500 --out trials.npz
    python clone_pick_one.py train trials.npz --seeds 3 --episodes 100

``collect`` plays the repertoire's best pick-up of one object under the benchmark's errors. The arm is pushed off its way at random while it plays, so that
the data show how the script finds back. Episodes that succeed are kept. ``train`` fits small networks, with what the pads' images show and without, and
counts how often each lifts the object in episodes that nothing was collected in. The script goes by stages, so the networks see the last second: what was
measured and asked for now and `BEFORE` steps ago.

It needs numpy and gymnasium beside ftac.
"""

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor

os.environ.setdefault("RAYON_NUM_THREADS", "1")

import gymnasium  # noqa: E402
import numpy as np  # noqa: E402

import ftac  # noqa: E402
from ftac.scripted import Script, pose_matrix  # noqa: E402

SIDE = 16
"""Of the tactile images, pixels."""
CELLS = 2
"""Side of a pad's picture as the network gets it."""
LEAST = 0.02
"""Change of colour, as a share of its range, below which a cell counts as untouched: noise and the cameras' drift, by which a network would tell the time and
the episode."""
PUSH = 0.12
"""Standard deviation of a push, as a share of the greatest speed; it lasts for PUSH_STEPS."""
PUSH_STEPS = 6
FLOOR = 0.05
"""Inputs that vary by less are not scaled up further."""
BEFORE = [0, 3, 8, 22]
"""Steps of 1/20 s ago of what a network sees; the hand closes in 22."""
NEAR = [3, 7, 11]
"""Where `felt_elsewhere` has the palm's place as the object was seen, m."""
CLOSE = 0.01
"""Distance from the place where the hand closes over which a network sees it finely, m."""
HELD_OUT = 1_000_000
"""Seeds of the episodes that policies are tested in begin here, unless others are asked for."""


def make(combination, tactile=True):
    images = SIDE if tactile else None
    return gymnasium.make("ftac/PickOne-v0", images=images, combination=combination).unwrapped


def script_of(env, observation, info):
    return Script(env, ftac.grasps.repertoire()[info["objects"][0]][0], observation["detected"][0], info["yaws"][0])


def touch(observation, untouched):
    """What the pads' images show against untouched ones: changes of colour beyond LEAST, (17 * CELLS * CELLS * 3,)."""
    change = (observation["tactile"].astype(np.float32) - untouched) / 255.0
    cells = change.reshape(17, CELLS, SIDE // CELLS, CELLS, SIDE // CELLS, 3).mean(axis=(2, 4)).ravel()
    return 20.0 * np.sign(cells) * np.maximum(np.abs(cells) - LEAST, 0.0)


def felt_elsewhere(observation):
    """Where the palm is as the object was seen, what the servos measure, and what was asked for last."""
    seen, palm = (pose_matrix(pose.astype(np.float64)) for pose in (observation["detected"][0], observation["palm"]))
    near = np.linalg.inv(seen) @ palm
    servos = observation["servos"][:, [0, 2]].ravel()
    return np.concatenate([near[:3, :].ravel(), palm[2:3, 3], servos, observation["command"]]).astype(np.float32)


def play(env, seed, policy, push=0.0):
    """An episode: measurements, touches, the policy's actions, and whether it succeeded."""
    random = np.random.default_rng(seed)
    observation, info = env.reset(seed=seed)
    untouched = observation["tactile"].astype(np.float32) if env.images else None
    decide = policy(env, observation, info)
    rows, pushed = ([], [], []), np.zeros(12, dtype=np.float32)
    for step in range(300):
        felt = touch(observation, untouched) if env.images else np.zeros(0, dtype=np.float32)
        rows[0].append(felt_elsewhere(observation))
        rows[1].append(felt)
        action = decide(observation, rows[0], rows[1])
        rows[2].append(action)
        if step % PUSH_STEPS == 0:
            pushed[:6] = push * random.standard_normal(6)
        observation, _, over, _, info = env.step(np.clip(action + pushed, -1.0, 1.0))
        if over:
            break
    return *(np.array(kept, dtype=np.float32) for kept in rows), bool(info["is_success"])


def inputs_of(measured, felt, steps, place):
    """What a network sees in these steps of an episode, from all its measurements and touches: the palm finely about the `place` where the hand closes, and
    the last second. What was before the beginning is as in the beginning."""
    parts = [np.clip((measured[steps][:, NEAR] - place) / CLOSE, -3.0, 3.0), felt[steps]]
    parts += [measured[np.maximum(steps - before, 0)] for before in BEFORE]
    return np.concatenate(parts, axis=1)


def place_of(episodes):
    """Where the palm is when the hand begins to close, as the object is seen: the mean over episodes, m."""
    places = []
    for measured, _, _ in episodes:
        # The digits have their first posture after a second at most, and close later.
        change = np.abs(measured[20:, -6:-1] - measured[20, -6:-1]).max(axis=1)
        places.append(measured[20 + int(np.argmax(change > 0.1)), NEAR])
    return np.mean(places, axis=0)


def scripted(env, observation, info):
    script = script_of(env, observation, info)
    return lambda observation, measured, felt: script.act(observation)


def collected(job):
    combination, seed = job
    return play(make(combination), seed, scripted, PUSH)


def collect(args):
    kept, played = [], 0
    jobs = [(args.combination, seed) for seed in range(args.episodes)]
    with ProcessPoolExecutor(args.jobs) as workers:
        for *rows, success in workers.map(collected, jobs, chunksize=5):
            played += 1
            kept += [rows] if success else []
            if played % 25 == 0:
                print(f"{played} episodes, {len(kept)} succeeded", flush=True)
    if not kept:
        sys.exit(f"none of {played} episodes succeeded: nothing to learn from")
    lengths = [len(rows[0]) for rows in kept]
    measured, felt, action = (np.concatenate([rows[n] for rows in kept]) for n in range(3))
    partial = args.out + ".partial.npz"
    np.savez_compressed(partial, measured=measured, felt=felt, action=action, lengths=lengths, played=played)
    os.replace(partial, args.out)
    print(f"{len(kept)} of {played} episodes, {len(action)} steps in {args.out}")


class Network:
    """Two hidden layers of tanh, fitted by Adam to the mean squared error."""

    def __init__(self, inputs, outputs, hidden, random):
        sizes = [inputs.shape[1], hidden, hidden, outputs.shape[1]]
        self.mean, self.scale = inputs.mean(axis=0), np.maximum(inputs.std(axis=0), FLOOR)
        self.low, self.span = outputs.mean(axis=0), outputs.std(axis=0) + 1e-3
        self.weights = []
        for before, after in zip(sizes, sizes[1:]):
            bound = np.sqrt(1.0 / before)
            self.weights += [random.normal(0.0, bound, (before, after)).astype(np.float32), np.zeros(after, np.float32)]

    def layers(self, inputs):
        layers = [np.clip((inputs - self.mean) / self.scale, -5.0, 5.0)]
        for n in range(0, len(self.weights), 2):
            sums = layers[-1] @ self.weights[n] + self.weights[n + 1]
            layers.append(np.tanh(sums) if n + 2 < len(self.weights) else sums)
        return layers

    def __call__(self, inputs):
        return self.layers(inputs)[-1] * self.span + self.low

    def fit(self, inputs, outputs, epochs, random, batch=256, rate=1e-3):
        wanted = (outputs - self.low) / self.span
        first, second, count = [0.0 * w for w in self.weights], [0.0 * w for w in self.weights], 0
        for epoch in range(epochs):
            order, total = random.permutation(len(inputs)), 0.0
            pace = rate * 0.5 * (1.0 + np.cos(np.pi * epoch / epochs))
            for start in range(0, len(order), batch):
                chosen = order[start : start + batch]
                layers = self.layers(inputs[chosen])
                wrong = (layers[-1] - wanted[chosen]) / len(chosen)
                total += float((wrong**2).sum()) * len(chosen) ** 2
                count += 1
                for n in range(len(self.weights) - 2, -1, -2):
                    slopes = [layers[n // 2].T @ wrong, wrong.sum(axis=0)]
                    if n > 0:
                        wrong = (wrong @ self.weights[n].T) * (1.0 - layers[n // 2] ** 2)
                    for k, slope in enumerate(slopes, n):
                        first[k] = 0.9 * first[k] + 0.1 * slope
                        second[k] = 0.999 * second[k] + 0.001 * slope**2
                        step = first[k] / (1.0 - 0.9**count) / (np.sqrt(second[k] / (1.0 - 0.999**count)) + 1e-8)
                        self.weights[k] -= (pace * step).astype(np.float32)
            if epoch % 10 == 9:
                print(f"  epoch {epoch + 1}: mean squared error {total / wanted.size:.4f}", flush=True)


def wanted(measured, action):
    """What a network is to answer: the palm's twist, and by how much tensions and opposition change. Asked for the tensions themselves, it would repeat the
    last ones, which it is told, and never close the hand."""
    return np.concatenate([action[:, :6], action[:, 6:] - measured[:, -6:]], axis=1)


def carried_out(measured, answer):
    """The action that an answer asks for."""
    return np.clip(np.concatenate([answer[:6], measured[-6:] + answer[6:]]), -1.0, 1.0).astype(np.float32)


def tested(job):
    network, place, tactile, combination, seed = job

    def policy(*_):
        def decide(observation, measured, felt):
            now = np.array([len(measured) - 1])
            inputs = inputs_of(np.array(measured), np.array(felt), now, place)
            return carried_out(measured[-1], network(inputs)[0])

        return decide

    return play(make(combination, tactile), seed, policy)[-1]


def expert(job):
    combination, seed = job
    return play(make(combination, False), seed, scripted)[-1]


def interval(count, of, z=1.96):
    """95 % interval of a share (Wilson)."""
    share, spread = count / of, z * z / of
    middle, half = share + spread / 2, z * np.sqrt(share * (1 - share) / of + spread / (4 * of))
    return f"{count} of {of} ({max(0.0, (middle - half) / (1 + spread)):.2f} to {min(1.0, (middle + half) / (1 + spread)):.2f})"


def train(args):
    data = np.load(args.trials)
    ends = np.cumsum(data["lengths"])[:-1]
    episodes = list(zip(*(np.split(data[name], ends) for name in ("measured", "felt", "action"))))
    place = place_of(episodes)
    seeds = [args.first_seed + n for n in range(args.episodes)]
    with ProcessPoolExecutor(args.jobs) as workers:
        best = sum(workers.map(expert, [(args.combination, seed) for seed in seeds]))
        print(f"the script itself: {interval(best, len(seeds))}", flush=True)
        for tactile in (True, False):
            name, total = "with tactile images" if tactile else "without", 0
            rows = []
            for measured, felt, _ in episodes:
                felt = felt if tactile else felt[:, :0]
                rows.append(inputs_of(measured, felt, np.arange(len(measured)), place))
            inputs = np.concatenate(rows)
            answers = wanted(data["measured"], data["action"])
            for seed in range(args.seeds):
                random = np.random.default_rng(seed)
                network = Network(inputs, answers, args.hidden, random)
                network.fit(inputs, answers, args.epochs, random)
                jobs = [(network, place, tactile, args.combination, episode) for episode in seeds]
                succeeded = sum(workers.map(tested, jobs))
                total += succeeded
                print(f"{name}, seed {seed}: {interval(succeeded, len(seeds))} episodes succeed", flush=True)
            print(f"{name}, all networks: {total} of {args.seeds * len(seeds)}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--combination", type=int, default=1, help="its first object is picked; see ftac.combinations()")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    commands = parser.add_subparsers(required=True)
    collecting = commands.add_parser("collect", help="play the script and keep what it did")
    collecting.add_argument("--episodes", type=int, default=500)
    collecting.add_argument("--out", default="trials.npz")
    collecting.set_defaults(run=collect)
    training = commands.add_parser("train", help="fit networks and test them")
    training.add_argument("trials")
    training.add_argument("--seeds", type=int, default=3, help="networks of each kind")
    training.add_argument("--episodes", type=int, default=100, help="that each network is tested in")
    training.add_argument("--first-seed", type=int, default=HELD_OUT, help="of these episodes")
    training.add_argument("--epochs", type=int, default=40)
    training.add_argument("--hidden", type=int, default=128)
    training.set_defaults(run=train)
    args = parser.parse_args()
    args.run(args)


if __name__ == "__main__":
    main()
