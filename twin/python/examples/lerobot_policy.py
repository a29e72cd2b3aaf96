"""A policy of LeRobot that learns what a script does from a data set: ACT, or a diffusion policy.

    python lerobot_policy.py --policy act --episodes 660 --updates 12000 --seeds 5 --tests 198 --out act
    python lerobot_policy.py --task SortInHand --images 32 --episodes 600 --updates 8000 --seeds 5 --together 5 --tests 100 --out sort

Records episodes of a task of `imitate` in which the script is pushed, unless ``--dataset`` names some; trains policies on them; and tests each in
the environment, beside the script. ``--images 32`` adds the tactile images, which is for a GPU. A trained policy is a
policy of the benchmark too: class `Trained` in this file, ``ftac bench --policy lerobot_policy.py:Trained --policy-arg folder=act/act_0``.

It needs torch and LeRobot 0.4: ``pip install 'ftac[lerobot]' lerobot``.
"""

import argparse
import csv
import json
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("RAYON_NUM_THREADS", "1")

import gymnasium  # noqa: E402
import imitate  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from imitate import HELP_STEPS, PUSH_STEPS, TASKS, Results, Task, known_objects, scripts_of  # noqa: E402
from lerobot.configs.types import NormalizationMode  # noqa: E402
from lerobot.datasets.lerobot_dataset import LeRobotDatasetMetadata  # noqa: E402
from lerobot.datasets.utils import dataset_to_policy_features  # noqa: E402
from lerobot.policies.act.configuration_act import ACTConfig  # noqa: E402
from lerobot.policies.act.modeling_act import ACTPolicy  # noqa: E402
from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig  # noqa: E402
from lerobot.policies.diffusion.modeling_diffusion import DiffusionPolicy  # noqa: E402
from lerobot.policies.factory import make_pre_post_processors  # noqa: E402
from lerobot_samples import PICTURE, STATISTICS, Samples, features, with_picture, write_pictures  # noqa: E402
from network import FLOOR  # noqa: E402

from ftac.lerobot import Layout, PolicyAdapter, Taught, record  # noqa: E402

HELD_OUT = 6_000_000
"""Seeds of the test episodes begin here, unless others are asked for."""
CHUNK = 20
"""Actions that ACT predicts at once: the digits close in 22 steps, which the script does by a clock."""
POLICIES = {"act": ACTPolicy, "diffusion": DiffusionPolicy}
LAYOUT = "ftac.json"
"""File beside a policy's weights with the layout of its observations."""


class Trained(PolicyAdapter):
    """A trained policy of the folder in which this program left it."""

    def __init__(self, folder):
        folder = Path(folder)
        kind = json.loads((folder / "config.json").read_text())["type"]
        self.model = POLICIES[kind].from_pretrained(folder).eval()
        device = {"device_processor": {"device": str(self.model.config.device)}}
        self.before, self.after = make_pre_post_processors(self.model.config, str(folder), preprocessor_overrides=device)
        super().__init__(self.predict, folder / LAYOUT)

    def reset(self, info):
        super().reset(info)
        self.model.reset()

    def predict(self, batch):
        tensors = {key: torch.from_numpy(value) if isinstance(value, np.ndarray) else value for key, value in with_picture(batch, self.layout.pads).items()}
        with torch.inference_mode():
            return self.after(self.model.select_action(self.before(tensors)))


class Pushed:
    """The script, pushed at random: the data then have states into which a policy's errors lead, and what the script does there. As the pushes have a
    mean of zero, what is learned has them no longer.

    If there are several bins, it heads for a random one, drawn anew every `HELP_STEPS`, and the action for the right bin is recorded. Otherwise a policy
    would learn to keep its direction instead of using touch."""

    def __init__(self, task, push, env):
        self.scripts, self.right = scripts_of(env.unwrapped, task)
        self.push, self.random, self.steps = push, np.random.default_rng([env.unwrapped.np_random_seed, 1]), 0

    def __call__(self, observation):
        if self.steps % PUSH_STEPS == 0:
            self.pushed = self.push * self.random.standard_normal(6)
        if self.steps % HELP_STEPS == 0:
            self.chosen = int(self.random.integers(len(self.scripts)))
        self.steps += 1
        proposed = [script.act(observation) for script in self.scripts]
        for action in proposed:
            action[:6] = np.clip(action[:6] + self.pushed, -1.0, 1.0)
        return Taught(proposed[self.chosen], proposed[self.right])


def make(objects, images, task):
    """An environment of the task whose actions are the tensions of the cables, not their changes: these are zero in most steps, and ACT, which fits the
    median, would never close the hand."""
    env = imitate.make(objects, images, task, hand="tensions")
    return gymnasium.wrappers.TimeLimit(env, TASKS[task.name].steps)


def configuration(kind, inputs, outputs, device):
    """Small networks: the observations are a few hundred numbers."""
    input_scales = {"STATE": NormalizationMode.MEAN_STD, "ENV": NormalizationMode.MEAN_STD, "VISUAL": NormalizationMode.MEAN_STD}
    shared = {"input_features": inputs, "output_features": outputs, "device": device, "push_to_hub": False}
    if kind == "act":
        scales = {**input_scales, "ACTION": NormalizationMode.MEAN_STD}
        # The script does one thing in each state: nothing is left for a latent variable.
        size = {"dim_model": 96, "n_heads": 4, "dim_feedforward": 256, "n_encoder_layers": 2, "use_vae": False}
        return ACTConfig(
            chunk_size=CHUNK,
            n_action_steps=CHUNK // 2,
            normalization_mapping=scales,
            optimizer_lr=3e-4,
            # The image encoder starts from random weights: there are no pretrained ones for such images.
            optimizer_lr_backbone=1e-4,
            pretrained_backbone_weights=None,
            **size,
            **shared,
        )
    scales = {**input_scales, "ACTION": NormalizationMode.MIN_MAX}
    size = {"down_dims": (64, 128), "diffusion_step_embed_dim": 64, "num_inference_steps": 10, "noise_scheduler_type": "DDIM"}
    return DiffusionConfig(normalization_mapping=scales, optimizer_lr=3e-4, crop_shape=None, **size, **shared)


class Source(NamedTuple):
    """What policies learn from: a data set, the file of its pictures if they see them, the configuration of the policies, and the statistics that scale
    what they see and do."""

    dataset: Path
    pictures: Path | None
    layout: Layout
    config: ACTConfig | DiffusionConfig
    statistics: dict[str, dict[str, np.ndarray]]


def without_images(layout):
    return replace(layout, spec=replace(layout.spec, images=None))


def layout_for(dataset, args, env):
    """The layout of what policies see: that of the data set, without images if they see none. ``ValueError`` if an episode of `env` has another one."""
    expected, found = Layout.of(env), Layout.read(dataset)
    found = without_images(found) if args.images is None else found
    if found != expected:
        raise ValueError(f"--dataset {dataset}: found {found}, expected {expected}")
    return found


def opened(dataset, layout, args):
    """The data set in a folder, for policies with this layout."""
    meta, pictures = LeRobotDatasetMetadata(dataset.name, root=dataset), None
    if args.images is not None:
        pictures = args.out / "pictures.npy"
        write_pictures(dataset, pictures, args.jobs)
    config = configuration(args.policy, *features(dataset_to_policy_features(meta.features), layout), args.device)
    return Source(dataset, pictures, layout, config, {**floored(meta.stats), PICTURE: STATISTICS})


def floored(statistics):
    """Statistics by which inputs that vary little are not scaled up further than in `imitate`; the actions' stay as they are."""
    inputs = {key: {**found, "std": np.maximum(found["std"], FLOOR)} for key, found in statistics.items() if key.startswith("observation.")}
    return {**statistics, **inputs}


def train(source, seed, folder, args):
    """Trains a policy, which is saved in the folder; returns the curve of its loss."""
    if args.together > 1:
        # The networks are small: threads of one would wait for those of the others.
        torch.set_num_threads(1)
    samples, curve = Samples(source.dataset, source.config, source.pictures), []
    torch.manual_seed(seed)
    model = POLICIES[args.policy](source.config).train()
    before, after = make_pre_post_processors(source.config, dataset_stats=source.statistics)
    rate = source.config.optimizer_lr
    optimizer = torch.optim.AdamW(model.get_optim_params(), lr=rate, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, [group.get("lr", rate) for group in optimizer.param_groups], args.updates)
    losses, begun, stretch = [], time.monotonic(), max(1, args.updates // 20)
    for update in range(1, args.updates + 1):
        loss, _ = model(before(samples.batch(torch.randint(len(samples), (args.batch,)))))
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 10.0)
        optimizer.step()
        schedule.step()
        losses.append(loss.detach())
        if update % stretch == 0:
            curve.append((update, float(torch.stack(losses[-stretch:]).mean())))
            print(f"  {folder.name}: update {update} of {args.updates}, loss {curve[-1][1]:.4f}, {time.monotonic() - begun:.0f} s", flush=True)
    for part in (model, before, after):
        part.save_pretrained(folder)
    (folder / LAYOUT).write_text(json.dumps({"layout": source.layout.as_dict()}))
    return curve


@cache
def trained(folder):
    torch.set_num_threads(1)
    return Trained(folder)


def episode(job):
    """Runs a test episode: whether the task was done in the end. Without a folder the script moves the robot."""
    object_, task, seed, folder = job
    policy = trained(folder) if folder else None
    env = make([object_], policy.layout.spec.images if folder else None, task)
    observation, info = env.reset(seed=seed)
    if folder:
        torch.manual_seed(seed)
        policy.reset(info)
    else:
        scripts, right = scripts_of(env.unwrapped, task)
        policy = scripts[right]
    over = False
    while not over:
        observation, _, terminated, truncated, info = env.step(policy.act(observation))
        over = terminated or truncated
    return bool(info["is_success"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", choices=list(POLICIES), default="act")
    parser.add_argument("--task", choices=list(TASKS), default="PickOne")
    parser.add_argument("--objects", help="of PickOne: names with commas between; all that the repertoire has if left out")
    parser.add_argument("--trained", type=Path, nargs="+", help="folders of trained policies: only tests them")
    parser.add_argument("--dataset", type=Path, help="folder of a data set of the same observations; recorded if left out")
    parser.add_argument("--episodes", type=int, default=660, help="to record")
    parser.add_argument("--push", type=float, help="standard deviation of pushes in these episodes, as a share of the greatest velocity; the task's if left out")
    parser.add_argument("--images", type=int, help="side of the tactile images, pixels; none if left out")
    parser.add_argument("--updates", type=int, default=12000, help="of the weights of each policy")
    parser.add_argument("--batch", type=int, default=64, help="samples of an update")
    parser.add_argument("--seeds", type=int, default=1, help="policies to train, each with a seed of its own")
    parser.add_argument("--together", type=int, default=1, help="policies that are trained at a time")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu", help="of torch; that which is there if left out")
    parser.add_argument("--tests", type=int, default=330, help="episodes in which each policy is tested")
    parser.add_argument("--first-seed", type=int, default=HELD_OUT, help="of the test episodes")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes that record and test")
    parser.add_argument("--out", type=Path, default=Path("lerobot_policy"))
    args = parser.parse_args()
    if args.out.exists():
        parser.error(f"--out: found {args.out}, expected a new folder")
    args.out.mkdir(parents=True)
    task, objects, folders = Task(args.task), known_objects(args.objects), args.trained
    spawn = get_context("spawn")
    if folders is None:
        dataset, folders = args.dataset or args.out / "dataset", [args.out / f"{args.policy}_{seed}" for seed in range(args.seeds)]
        if args.dataset is None:
            push = TASKS[args.task].push if args.push is None else args.push
            # Where it is led to places drawn at random, success says nothing.
            alone = args.task == "PickOne"
            policy = partial(Pushed, task, push)
            wrote = record(partial(make, objects, args.images, task), policy, args.episodes, dataset, only_successes=alone, jobs=args.jobs)
            print(f"{wrote['episodes']} of {wrote['attempts']} episodes written, {wrote['bytes'] / 1e6:.1f} MB, {wrote['frames']} frames", flush=True)
        try:
            layout = layout_for(dataset, args, make(objects, args.images, task))
        except ValueError as error:
            parser.error(str(error))
        source = opened(dataset, layout, args)
        print(f"training on {args.device}", flush=True)
        with open(args.out / "curve.csv", "w", newline="") as file, ProcessPoolExecutor(args.together, mp_context=spawn) as workers:
            table = csv.writer(file)
            table.writerow(["policy", "update", "loss"])
            runs = [workers.submit(train, source, seed, folder, args) for seed, folder in enumerate(folders)]
            for folder, run in zip(folders, runs):
                table.writerows([folder.name, update, f"{loss:.5f}"] for update, loss in run.result())
                file.flush()
    with Results(args.out / "results.csv", "policy") as results, ProcessPoolExecutor(args.jobs, mp_context=spawn) as workers:
        for name, folder in [("script", None), *((folder.name, str(folder)) for folder in folders)]:
            jobs = [(objects[n % len(objects)], task, args.first_seed + n, folder) for n in range(args.tests)]
            results.add(name, list(workers.map(episode, jobs, chunksize=2)), name)


if __name__ == "__main__":
    main()
