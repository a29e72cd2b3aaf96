"""A policy of LeRobot that learns the scripted pick-up from a data set: ACT, or a diffusion policy.

    python lerobot_policy.py --policy act --episodes 660 --updates 20000 --tests 330 --out act

Records episodes of ``ftac/PickOne-v1`` in which the script succeeds, unless ``--dataset`` names some; trains on them; and tests the policy in the
environment, beside the script. ``--images 64`` adds the tactile images, a video and an encoder for each pad, which is for a GPU. The trained policy is a
policy of the benchmark too: class `Trained` in this file, ``ftac bench --policy lerobot_policy.py:Trained --policy-arg folder=act``.

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

os.environ.setdefault("RAYON_NUM_THREADS", "1")

import gymnasium  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from imitate import PUSH_STEPS, interval, known_objects  # noqa: E402
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


def kind_of(folder):
    """``act`` or ``diffusion``: the policy in the folder of an earlier run."""
    return json.loads((folder / "config.json").read_text())["type"]


class Trained(PolicyAdapter):
    """A trained policy of the folder in which this program left it."""

    def __init__(self, folder):
        folder = Path(folder)
        self.model = POLICIES[kind_of(folder)].from_pretrained(folder).eval()
        device = {"device_processor": {"device": str(self.model.config.device)}}
        self.before, self.after = make_pre_post_processors(self.model.config, str(folder), preprocessor_overrides=device)
        super().__init__(self.choose, folder / "ftac.json")

    def reset(self, info):
        super().reset(info)
        self.model.reset()

    def choose(self, batch):
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
    return gymnasium.make("ftac/PickOne-v1", objects=objects, grasp=True, images=images, tactile="change", max_episode_steps=STEPS)


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


def batches(data, args):
    """Batches in random order, without end. Without images, all samples are read once and stay in memory."""
    if args.images:
        loader = torch.utils.data.DataLoader(data, batch_size=args.batch, shuffle=True, drop_last=True, num_workers=args.loaders)
        while True:
            yield from loader
    # The task's words are no tensor.
    samples = [{key: value for key, value in data[n].items() if isinstance(value, torch.Tensor)} for n in range(len(data))]
    together = torch.utils.data.default_collate(samples)
    print(f"{len(samples)} samples read", flush=True)
    while True:
        chosen = torch.randint(len(samples), (args.batch,))
        yield {key: value[chosen] for key, value in together.items()}


def train(args, dataset):
    """Trains a policy on the data set; returns the curve of its loss."""
    torch.manual_seed(args.seed)
    meta = LeRobotDatasetMetadata(dataset.name, root=dataset)
    found = dataset_to_policy_features(meta.features)
    outputs = {key: feature for key, feature in found.items() if feature.type is FeatureType.ACTION}
    inputs = {key: feature for key, feature in found.items() if key not in outputs}
    config = configuration(args.policy, inputs, outputs, args.device)
    model = POLICIES[args.policy](config).train()
    before, after = make_pre_post_processors(config, dataset_stats=meta.stats)
    data = LeRobotDataset(dataset.name, root=dataset, delta_timestamps=resolve_delta_timestamps(config, meta), video_backend="pyav")
    optimizer = torch.optim.AdamW(model.get_optim_params(), lr=config.optimizer_lr, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, [group.get("lr", config.optimizer_lr) for group in optimizer.param_groups], args.updates)
    curve, losses, begun = [], [], time.monotonic()
    for batch in islice(batches(data, args), args.updates):
        loss, _ = model(before(batch))
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 10.0)
        optimizer.step()
        schedule.step()
        losses.append(loss.item())
        if len(losses) % max(1, args.updates // 20) == 0:
            recent = losses[-max(1, args.updates // 20) :]
            curve.append((len(losses), float(np.mean(recent))))
            print(f"  update {curve[-1][0]} of {args.updates}: loss {curve[-1][1]:.4f}, {time.monotonic() - begun:.0f} s", flush=True)
    for part in (model, before, after):
        part.save_pretrained(args.out)
    (args.out / "ftac.json").write_text((dataset / "meta/ftac.json").read_text())
    return curve


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
    parser.add_argument("--trained", type=Path, help="folder of an earlier run: only tests it")
    parser.add_argument("--dataset", type=Path, help="folder of a data set of the same observations; recorded if left out")
    parser.add_argument("--episodes", type=int, default=660, help="to record")
    parser.add_argument("--push", type=float, default=0.1, help="standard deviation of pushes in these episodes, as a share of the greatest velocity")
    parser.add_argument("--images", type=int, help="side of the tactile images, pixels; none if left out")
    parser.add_argument("--updates", type=int, default=20000, help="of the weights")
    parser.add_argument("--batch", type=int, default=64, help="samples of an update")
    parser.add_argument("--loaders", type=int, default=0, help="processes that read the images")
    parser.add_argument("--seed", type=int, default=0, help="of the training")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu", help="of torch; that which is there if left out")
    parser.add_argument("--tests", type=int, default=330, help="episodes in which the policy is tested")
    parser.add_argument("--first-seed", type=int, default=HELD_OUT, help="of the test episodes")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes of the tests")
    parser.add_argument("--out", type=Path, default=Path("lerobot_policy"))
    args = parser.parse_args()
    if args.out.exists():
        parser.error(f"--out: found {args.out}, expected a new folder")
    args.out.mkdir(parents=True)
    objects, folder = known_objects(args.objects), args.trained
    if folder is None:
        folder, dataset = args.out, args.dataset or args.out / "dataset"
        if args.dataset is None:
            random = np.random.default_rng(args.seed)
            pushed = lambda env: Pushed(Script(env.unwrapped.features), args.push, random).act  # noqa: E731
            wrote = record(make(objects, args.images), pushed, args.episodes, dataset)
            print(f"{wrote['episodes']} of {wrote['attempts']} episodes written, {wrote['bytes'] / 1e6:.1f} MB, {wrote['frames']} frames")
        print(f"training on {args.device}")
        curve = train(args, dataset)
        with open(args.out / "curve.csv", "w", newline="") as file:
            csv.writer(file).writerows([("update", "loss"), *curve])
    with open(args.out / "results.csv", "w", newline="") as file, ProcessPoolExecutor(args.jobs) as workers:
        table = csv.writer(file)
        table.writerow(["policy", "successes", "episodes", "outcomes"])
        for name, policy in (("script", None), (kind_of(folder), str(folder))):
            jobs = [(objects[n % len(objects)], args.first_seed + n, policy, args.images) for n in range(args.tests)]
            won = list(workers.map(episode, jobs, chunksize=2))
            table.writerow([name, sum(won), len(won), "".join("01"[one] for one in won)])
            file.flush()
            print(f"{name}: {interval(sum(won), len(won))}", flush=True)


if __name__ == "__main__":
    main()
