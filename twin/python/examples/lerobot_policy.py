"""A policy of LeRobot that learns the scripted pick-up from a data set: ACT, or a diffusion policy.

    python lerobot_policy.py --policy act --episodes 660 --updates 12000 --seeds 5 --tests 198 --out act

Records episodes of ``ftac/PickOne-v1`` in which the script succeeds though it is pushed, unless ``--dataset`` names some; trains policies on them; and tests each in
the environment, beside the script. ``--images 64`` adds the tactile images, a video and an encoder for each pad, which is for a GPU. A trained policy is a
policy of the benchmark too: class `Trained` in this file, ``ftac bench --policy lerobot_policy.py:Trained --policy-arg folder=act/act_0``.

It needs torch and LeRobot 0.4: ``pip install 'ftac[lerobot]' lerobot``.
"""

import argparse
import csv
import json
import os
import time
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import islice
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("RAYON_NUM_THREADS", "1")

import gymnasium  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from imitate import PUSH, PUSH_STEPS, interval, known_objects  # noqa: E402
from lerobot.configs.types import FeatureType, NormalizationMode  # noqa: E402
from lerobot.datasets.factory import resolve_delta_timestamps  # noqa: E402
from lerobot.datasets.lerobot_dataset import LeRobotDataset, LeRobotDatasetMetadata  # noqa: E402
from lerobot.datasets.utils import dataset_to_policy_features  # noqa: E402
from lerobot.policies.act.configuration_act import ACTConfig  # noqa: E402
from lerobot.policies.act.modeling_act import ACTPolicy  # noqa: E402
from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig  # noqa: E402
from lerobot.policies.diffusion.modeling_diffusion import DiffusionPolicy  # noqa: E402
from lerobot.policies.factory import make_pre_post_processors  # noqa: E402

from ftac.lerobot import PolicyAdapter, record  # noqa: E402
from ftac.scripted import Script  # noqa: E402

STEPS = 260
"""Length of an episode, steps of 1/20 s."""
HELD_OUT = 6_000_000
"""Seeds of the test episodes begin here, unless others are asked for."""
CHUNK = 20
"""Actions that ACT predicts at once: the digits close in 22 steps, which the script does by a clock."""
POLICIES = {"act": ACTPolicy, "diffusion": DiffusionPolicy}


class Trained(PolicyAdapter):
    """A trained policy of the folder in which this program left it."""

    def __init__(self, folder):
        folder = Path(folder)
        kind = json.loads((folder / "config.json").read_text())["type"]
        self.model = POLICIES[kind].from_pretrained(folder).eval()
        device = {"device_processor": {"device": str(self.model.config.device)}}
        self.before, self.after = make_pre_post_processors(self.model.config, str(folder), preprocessor_overrides=device)
        super().__init__(self.predict, folder / "ftac.json")

    def reset(self, info):
        super().reset(info)
        self.model.reset()

    def predict(self, batch):
        tensors = {key: torch.from_numpy(value) if isinstance(value, np.ndarray) else value for key, value in batch.items()}
        with torch.inference_mode():
            return self.after(self.model.select_action(self.before(tensors)))


class Pushed:
    """The script, pushed at random: the data then have states into which a policy's errors lead, and what the script does there. As the pushes have a
    mean of zero, what is learned has them no longer."""

    def __init__(self, script, push, random):
        self.script, self.push, self.random, self.steps, self.pushed = script, push, random, 0, np.zeros(6)

    def act(self, observation):
        if self.steps % PUSH_STEPS == 0:
            self.pushed = self.push * self.random.standard_normal(6)
        self.steps += 1
        action = self.script.act(observation)
        action[:6] = np.clip(action[:6] + self.pushed, -1.0, 1.0)
        return action


def make(objects, images):
    """The hand is moved by tensions, not by their changes: these are zero but for some steps, and ACT, which fits the median, would never close the hand."""
    options = {"hand": "tensions", "grasp": True, "images": images, "tactile": "change"}
    return gymnasium.make("ftac/PickOne-v1", objects=objects, **options, max_episode_steps=STEPS)


def configuration(kind, inputs, outputs, device):
    """Small networks: the observations are a few hundred numbers."""
    # What is scaled to -1 to 1 already stays as it is.
    same = {"STATE": NormalizationMode.IDENTITY, "ENV": NormalizationMode.IDENTITY, "VISUAL": NormalizationMode.IDENTITY}
    shared = {"input_features": inputs, "output_features": outputs, "device": device, "push_to_hub": False}
    if kind == "act":
        scales = {**same, "ACTION": NormalizationMode.MEAN_STD}
        # The script does one thing in each state: nothing is left for a latent variable.
        size = {"dim_model": 96, "n_heads": 4, "dim_feedforward": 256, "n_encoder_layers": 2, "use_vae": False}
        return ACTConfig(
            chunk_size=CHUNK, n_action_steps=CHUNK // 2, normalization_mapping=scales, optimizer_lr=3e-4, pretrained_backbone_weights=None, **size, **shared
        )
    scales = {**same, "ACTION": NormalizationMode.MIN_MAX}
    size = {"down_dims": (64, 128), "diffusion_step_embed_dim": 64, "num_inference_steps": 10, "noise_scheduler_type": "DDIM"}
    return DiffusionConfig(normalization_mapping=scales, optimizer_lr=3e-4, crop_shape=None, **size, **shared)


class Source(NamedTuple):
    """A data set, what it says of itself, the configuration of a policy that learns from it, and without images all samples."""

    samples: LeRobotDataset
    meta: LeRobotDatasetMetadata
    config: ACTConfig | DiffusionConfig
    together: dict[str, torch.Tensor] | None


def opened(dataset, args):
    """The data set in a folder. Without images, all samples are read once and stay in memory."""
    meta = LeRobotDatasetMetadata(dataset.name, root=dataset)
    found = dataset_to_policy_features(meta.features)
    outputs = {key: feature for key, feature in found.items() if feature.type is FeatureType.ACTION}
    inputs = {key: feature for key, feature in found.items() if key not in outputs}
    config = configuration(args.policy, inputs, outputs, args.device)
    samples = LeRobotDataset(dataset.name, root=dataset, delta_timestamps=resolve_delta_timestamps(config, meta), video_backend="pyav")
    if args.images:
        return Source(samples, meta, config, None)
    print(f"reading {len(samples)} samples into memory", flush=True)
    # The task's words are no tensor.
    tensors = [{key: value for key, value in samples[n].items() if isinstance(value, torch.Tensor)} for n in range(len(samples))]
    return Source(samples, meta, config, torch.utils.data.default_collate(tensors))


def batches(source, args):
    """Batches in random order, without end."""
    if source.together is None:
        loader = torch.utils.data.DataLoader(source.samples, batch_size=args.batch, shuffle=True, drop_last=True, num_workers=args.loaders)
        while True:
            yield from loader
    while True:
        chosen = torch.randint(len(source.samples), (args.batch,))
        yield {key: value[chosen] for key, value in source.together.items()}


def train(source, seed, folder, args):
    """Trains a policy, which is saved in the folder; yields the curve of its loss."""
    torch.manual_seed(seed)
    model = POLICIES[args.policy](source.config).train()
    before, after = make_pre_post_processors(source.config, dataset_stats=source.meta.stats)
    rate = source.config.optimizer_lr
    optimizer = torch.optim.AdamW(model.get_optim_params(), lr=rate, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, [group.get("lr", rate) for group in optimizer.param_groups], args.updates)
    losses, begun = [], time.monotonic()
    for batch in islice(batches(source, args), args.updates):
        loss, _ = model(before(batch))
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 10.0)
        optimizer.step()
        schedule.step()
        losses.append(loss.item())
        if len(losses) % max(1, args.updates // 20) == 0:
            recent = float(np.mean(losses[-max(1, args.updates // 20) :]))
            yield len(losses), recent
            print(f"  update {len(losses)} of {args.updates}: loss {recent:.4f}, {time.monotonic() - begun:.0f} s", flush=True)
    for part in (model, before, after):
        part.save_pretrained(folder)
    (folder / "ftac.json").write_text((source.samples.root / "meta/ftac.json").read_text())


@cache
def trained(folder):
    torch.set_num_threads(1)
    return Trained(folder)


def episode(job):
    """Runs a test episode: whether the object was held in the end. Without a folder the script moves the robot."""
    object_, seed, folder, images = job
    env = make([object_], images if folder else None)
    observation, info = env.reset(seed=seed)
    policy = trained(folder) if folder else Script(env.unwrapped.features)
    if folder:
        torch.manual_seed(seed)
        policy.reset(info)
    over = False
    while not over:
        observation, _, terminated, truncated, info = env.step(policy.act(observation))
        over = terminated or truncated
    return bool(info["is_success"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", choices=list(POLICIES), default="act")
    parser.add_argument("--objects", help="names with commas between; all that the repertoire has if left out")
    parser.add_argument("--trained", type=Path, nargs="+", help="folders of trained policies: only tests them")
    parser.add_argument("--dataset", type=Path, help="folder of a data set of the same observations; recorded if left out")
    parser.add_argument("--episodes", type=int, default=660, help="to record")
    parser.add_argument("--push", type=float, default=PUSH, help="standard deviation of pushes in these episodes, as a share of the greatest velocity")
    parser.add_argument("--images", type=int, help="side of the tactile images, pixels; none if left out")
    parser.add_argument("--updates", type=int, default=12000, help="of the weights of each policy")
    parser.add_argument("--batch", type=int, default=64, help="samples of an update")
    parser.add_argument("--loaders", type=int, default=0, help="processes that read the images")
    parser.add_argument("--seeds", type=int, default=1, help="policies to train, each with a seed of its own")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu", help="of torch; that which is there if left out")
    parser.add_argument("--tests", type=int, default=330, help="episodes in which each policy is tested")
    parser.add_argument("--first-seed", type=int, default=HELD_OUT, help="of the test episodes")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes of the tests")
    parser.add_argument("--out", type=Path, default=Path("lerobot_policy"))
    args = parser.parse_args()
    if args.out.exists():
        parser.error(f"--out: found {args.out}, expected a new folder")
    args.out.mkdir(parents=True)
    objects, folders = known_objects(args.objects), args.trained
    if folders is None:
        dataset, folders = args.dataset or args.out / "dataset", [args.out / f"{args.policy}_{seed}" for seed in range(args.seeds)]
        if args.dataset is None:
            random = np.random.default_rng(0)

            def pushed(env):
                return Pushed(Script(env.unwrapped.features), args.push, random).act

            wrote = record(make(objects, args.images), pushed, args.episodes, dataset)
            print(f"{wrote['episodes']} of {wrote['attempts']} episodes written, {wrote['bytes'] / 1e6:.1f} MB, {wrote['frames']} frames")
        source = opened(dataset, args)
        with open(args.out / "curve.csv", "w", newline="") as file:
            table = csv.writer(file)
            table.writerow(["policy", "update", "loss"])
            for seed, folder in enumerate(folders):
                print(f"training {folder.name} on {args.device}", flush=True)
                for update, loss in train(source, seed, folder, args):
                    table.writerow([folder.name, update, f"{loss:.5f}"])
                    file.flush()
    with open(args.out / "results.csv", "w", newline="") as file, ProcessPoolExecutor(args.jobs) as workers:
        table = csv.writer(file)
        table.writerow(["policy", "successes", "episodes", "outcomes"])
        for name, folder in [("script", None), *((folder.name, str(folder)) for folder in folders)]:
            jobs = [(objects[n % len(objects)], args.first_seed + n, folder, args.images) for n in range(args.tests)]
            won = list(workers.map(episode, jobs, chunksize=2))
            table.writerow([name, sum(won), len(won), "".join("01"[one] for one in won)])
            file.flush()
            print(f"{name}: {interval(sum(won), len(won))}", flush=True)


if __name__ == "__main__":
    main()
