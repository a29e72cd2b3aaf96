"""All samples of a data set as batches for LeRobot's policies: the vectors in memory, the tactile images of all pads side by side in one picture.

LeRobot's own reader takes minutes for the vectors, and decodes the frames of 17 videos anew for every batch. One picture is also one camera to a policy, which
passes each camera through its network by itself.
"""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import torch
from lerobot.configs.types import FeatureType, PolicyFeature

from ftac.lerobot.layout import ACTION, IMAGES, Layout
from ftac.lerobot.tables import read_column
from ftac.lerobot.video import read

PICTURE = IMAGES + "pads"
"""Key of the picture."""
COLUMNS = 5
"""Pads in a row of the picture."""
STATISTICS = {"mean": np.full((3, 1, 1), 128.0 / 255.0), "std": np.full((3, 1, 1), 0.05)}
"""Mean and standard deviation that scale the picture: 0 for no change, about 1 for a clear contact."""


def picture_shape(pads, side):
    """Channels, rows and columns of the picture of so many pads."""
    return 3, -(-pads // COLUMNS) * side, COLUMNS * side


def place(number, side):
    """Rows and columns of a pad's image in the picture."""
    row, column = side * (number // COLUMNS), side * (number % COLUMNS)
    return slice(row, row + side), slice(column, column + side)


def with_picture(batch, pads):
    """A batch of `Layout.batch` with the picture in place of the images of the `pads`; without images it stays as it is."""
    keys = [IMAGES + pad for pad in pads]
    if keys[0] not in batch:
        return batch
    side = batch[keys[0]].shape[-1]
    picture = torch.full((len(batch[keys[0]]), *picture_shape(len(keys), side)), 128.0 / 255.0)
    for number, key in enumerate(keys):
        picture[(..., *place(number, side))] = torch.as_tensor(batch[key])
    return {**{key: value for key, value in batch.items() if key not in keys}, PICTURE: picture}


def features(found, layout):
    """Of the features that LeRobot finds in a data set, inputs and outputs of a policy, with the picture in place of the images if it has any."""
    vectors = {key: feature for key, feature in found.items() if feature.type is not FeatureType.VISUAL}
    inputs = {key: feature for key, feature in vectors.items() if feature.type is not FeatureType.ACTION}
    if layout.spec.images is not None:
        inputs[PICTURE] = PolicyFeature(FeatureType.VISUAL, picture_shape(len(layout.pads), layout.spec.images))
    return inputs, {key: feature for key, feature in vectors.items() if key not in inputs}


def tables_of(dataset):
    """The files with the vectors of a data set, in order."""
    return sorted(dataset.glob("data/*/*.parquet"))


def write_pictures(dataset, path, jobs):
    """Decodes the videos of all pads of a data set in so many processes, and writes the pictures (n, 3, rows, columns) uint8 to a file of numpy."""
    layout = Layout.read(dataset)
    side, keys = layout.spec.images, [IMAGES + pad for pad in layout.pads]
    count = len(read_column(tables_of(dataset), "index"))
    pictures = np.lib.format.open_memmap(path, "w+", np.uint8, (count, *picture_shape(len(keys), side)))
    pictures[:] = 128
    pictures.flush()
    with ProcessPoolExecutor(min(jobs, len(keys)), mp_context=get_context("spawn")) as pool:
        list(pool.map(write_pad, ((dataset / "videos" / key, path, place(number, side)) for number, key in enumerate(keys))))


def write_pad(job):
    """Writes the frames of one pad to their place in the file of the pictures."""
    videos, path, (rows, columns) = job
    pictures = np.load(path, mmap_mode="r+")
    images = np.concatenate([read(file) for file in sorted(videos.glob("*/*.mp4"))])
    if len(images) != len(pictures):
        raise ValueError(f"{videos}: found {len(images)} frames, expected {len(pictures)}")
    pictures[..., rows, columns] = images.transpose(0, 3, 1, 2)
    pictures.flush()


class Samples:
    """Samples of a data set for a policy's configuration, on its device. `pictures` is the file of `write_pictures`, if the policy sees them."""

    def __init__(self, dataset, config, pictures):
        paths = tables_of(dataset)
        self.device = torch.device(config.device)
        self.columns = {
            key: torch.from_numpy(read_column(paths, key)).to(self.device) for key in [*config.input_features, ACTION] if key != PICTURE
        }
        if pictures is not None:
            self.columns[PICTURE] = torch.from_numpy(np.load(pictures, mmap_mode="c")).to(self.device)
        episode = read_column(paths, "episode_index")[:, 0]
        bounds = [np.searchsorted(episode, episode, side=side) for side in ("left", "right")]
        self.first, self.end = (torch.from_numpy(bound).to(self.device) for bound in bounds)
        steps = {key: config.action_delta_indices if key == ACTION else config.observation_delta_indices for key in self.columns}
        self.steps = {key: torch.tensor(found, device=self.device) for key, found in steps.items() if found is not None}

    def __len__(self):
        return len(self.first)

    def batch(self, chosen):
        """The samples of these numbers: of each key the rows at the steps that the policy asks for; beyond the episode, its first or last row."""
        chosen = chosen.to(self.device)
        found = {}
        for key, rows in self.columns.items():
            at = chosen
            if key in self.steps:
                asked = chosen[:, None] + self.steps[key]
                first, end = self.first[chosen, None], self.end[chosen, None]
                at = torch.clamp(asked, first, end - 1)
                found[f"{key}_is_pad"] = (asked < first) | (asked >= end)
            found[key] = rows[at].float() / 255.0 if key == PICTURE else rows[at]
        return found
