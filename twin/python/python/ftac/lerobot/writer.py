"""Writes a data set in LeRobot's format v3.0, episode after episode.

The data set grows in the folder ``OUT.partial`` and gets its name last, so that there is never half of one. A file of several episodes is finished when its
table in ``meta/episodes`` has its final name; `Writer.resumed` continues after the last one that is.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ftac
from ftac.lerobot import statistics, tables
from ftac.lerobot.layout import ACTION, ENVIRONMENT, FILE, STATE, Layout
from ftac.lerobot.video import FPS, Quality, Video, quality_of

INDICES = ("frame_index", "episode_index", "index", "task_index")
FLAGS = ("next.done", "next.success")
VIDEO_BYTES = tables.VIDEO_MB << 20
"""Size of a video file from which the next episode begins another one."""


@dataclass
class Episode:
    """An episode to be written: arrays with a row for each step, in which a frame has an observation and the action that follows it."""

    task: str
    """The task in words."""
    vectors: dict[str, NDArray[Any]]
    """Vectors (n, k) by the data set's keys, among them ``action``."""
    images: dict[str, NDArray[np.uint8]]
    """Images (n, side, side, 3) by the data set's keys."""
    success: bool
    """Whether the task was done at the end."""
    reward: NDArray[Any] | None = None
    """Rewards (n,) of the steps; None for none."""
    about: dict[str, Any] = field(default_factory=dict)
    """Further columns of the episode's row in ``meta/episodes``, the same for all episodes."""


class Writer:
    """A data set in progress.

    Parameters
    ----------
    out: folder of the data set, which must not exist.
    layout: keys and shapes.
    video: ``lossless``, or a constant rate factor (`ftac.lerobot.video`).
    robot: name of the robot.
    rewards: whether episodes have rewards.
    made: facts for ``meta/ftac.json``: what the episodes are made of. A writer continues only one of the same facts.
    resume: whether to continue an incomplete data set of the same layout and facts; otherwise an incomplete one is replaced.
    """

    def __init__(
        self,
        out: Path,
        layout: Layout,
        *,
        video: Quality = "lossless",
        robot: str = "ftac_gen3",
        rewards: bool = False,
        made: Mapping[str, Any] | None = None,
        resume: bool = False,
    ) -> None:
        tables.require()
        self.out, self.layout, self.video, self.robot = out, layout, quality_of(video), robot
        self.root = out.with_name(out.name + ".partial")
        if out.exists():
            raise ValueError(f"{out}: it is there already, expected the name of a new folder")
        for key, side in layout.sides().items():
            if side % 2:
                raise ValueError(f"images: found {side} pixels for {key}, expected an even number")
        self._columns = [*layout.names(), "timestamp", *INDICES, *FLAGS, *(["next.reward"] if rewards else [])]
        self._state = {"layout": layout.as_dict(), "video": self.video, "made": dict(made or {}), "version": ftac.__version__}
        self.resumed = 0
        """Number of files that were finished before."""
        self.rows: list[dict[str, Any]] = []
        """Rows of ``meta/episodes`` of finished files."""
        if resume and (self.root / FILE).exists():
            self._resume()
        else:
            shutil.rmtree(self.root, ignore_errors=True)
            (self.root / "meta").mkdir(parents=True)
            (self.root / FILE).write_text(json.dumps(self._state, indent=1))
        self._tasks = {task: int(row["task_index"]) for row in self.rows for task in row["tasks"]}
        self._file = self.resumed
        self._open()

    def _open(self) -> None:
        """Begins the next file."""
        self._pending: list[dict[str, Any]] = []
        self._data: list[dict[str, NDArray[Any]]] = []
        self._videos: dict[str, Video] = {}
        self._levels: dict[str, NDArray[np.int64]] = {}

    @property
    def episodes(self) -> int:
        """Episodes so far."""
        return len(self.rows) + len(self._pending)

    @property
    def frames(self) -> int:
        """Frames so far."""
        last = (self._pending or self.rows)[-1:]
        return int(last[0]["dataset_to_index"]) if last else 0

    def add(self, episode: Episode) -> None:
        """Adds an episode. ``ValueError`` if a shape is not that of the layout; the data set stays as it was then."""
        count = self._checked(episode)
        number, total, first = self.episodes, self.frames, sum(row["length"] for row in self._pending)
        task = self._tasks.setdefault(episode.task, len(self._tasks))
        frames = np.arange(count)
        last = frames == count - 1
        columns: dict[str, NDArray[Any]] = {name: episode.vectors[name].astype(np.float32) for name in self.layout.names()}
        columns |= {
            "timestamp": (frames / FPS).astype(np.float32),
            "frame_index": frames,
            "episode_index": np.full(count, number),
            "index": total + frames,
            "task_index": np.full(count, task),
            "next.done": last,
            "next.success": last & episode.success,
        }
        if episode.reward is not None:
            columns["next.reward"] = episode.reward.astype(np.float32)
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [episode.task],
            "length": count,
            "data/chunk_index": self._file // tables.FILES,
            "data/file_index": self._file % tables.FILES,
            "dataset_from_index": total,
            "dataset_to_index": total + count,
            "meta/episodes/chunk_index": self._file // tables.FILES,
            "meta/episodes/file_index": self._file % tables.FILES,
            "task_index": task,
            "success": bool(episode.success),
            **episode.about,
        }
        found = {name: statistics.of_vectors(values.reshape(count, -1)) for name, values in columns.items()}
        sides = self.layout.sides()
        for key, side in sides.items():
            if key not in self._videos:
                self._videos[key] = Video(self._path(f"videos/{key}", "mp4"), side, self.video)
        with ThreadPoolExecutor(os.cpu_count()) as threads:
            list(threads.map(lambda key: self._videos[key].add(episode.images[key]), sides))
        for key in sides:
            levels = statistics.levels(episode.images[key])
            self._levels[key] = self._levels.get(key, np.zeros((3, 256), dtype=np.int64)) + levels
            found[key] = statistics.of_levels(levels, count)
            row |= {
                f"videos/{key}/chunk_index": self._file // tables.FILES,
                f"videos/{key}/file_index": self._file % tables.FILES,
                f"videos/{key}/from_timestamp": first / FPS,
                f"videos/{key}/to_timestamp": (first + count) / FPS,
            }
        row |= {f"stats/{name}/{part}": value for name, parts in found.items() for part, value in parts.items()}
        self._pending.append(row)
        self._data.append(columns)

    def is_full(self) -> bool:
        """Whether a video of the present file has reached `VIDEO_BYTES`."""
        paths = (self._path(f"videos/{key}", "mp4") for key in self._videos)
        return any(path.exists() and path.stat().st_size >= VIDEO_BYTES for path in paths)

    def finish_file(self, **about: Any) -> None:
        """Finishes the present file; the next episode begins another one. `about` is kept for `resumed_facts`."""
        for video in self._videos.values():
            video.finish()
        if self._pending:
            tables.write_data(self._path("data"), self._data, self.layout.names())
        np.savez(self._path("levels", "npz"), **self._levels)  # type: ignore[arg-type]
        self._path("facts", "json").write_text(json.dumps(about))
        # The table of episodes gets its name last: with it the file is finished.
        tables.write_episodes(self._path("meta/episodes"), self._pending)
        self.rows += self._pending
        self._file += 1
        self._open()

    def resumed_facts(self) -> list[dict[str, Any]]:
        """What `finish_file` was told for each finished file."""
        return [json.loads(self._path("facts", "json", n).read_text()) for n in range(self._file)]

    def vector_of(self, episode: int, name: str) -> NDArray[Any]:
        """A vector of an episode of a finished file, as it was added."""
        row = self.rows[episode]
        number = int(row["data/chunk_index"]) * tables.FILES + int(row["data/file_index"])
        first = self._first_of(number)
        column = tables.read_column([self._path("data", number=number)], name)
        return column[row["dataset_from_index"] - first : row["dataset_to_index"] - first]

    def bytes(self) -> int:
        """Size of the finished files."""
        folders = (self.root / "data", self.root / "videos", self.root / "meta")
        return sum(path.stat().st_size for folder in folders for path in folder.rglob("*") if path.is_file())

    def finish(self, card: str | None = None) -> dict[str, Any]:
        """Completes the data set, with `card` as its README.md. Returns ``dataset``, ``episodes``, ``frames`` and ``bytes``."""
        if self._pending:
            self.finish_file()
        if not self.rows:
            raise ValueError(f"{self.out}: found no episode, expected at least one")
        meta = self.root / "meta"
        for chunk in (meta / "episodes", self.root / "data"):
            tables.remove_empty(chunk)
        tables.write_tasks(meta / "tasks.parquet", self._tasks)
        tables.write_json(meta / "stats.json", self._statistics())
        tables.write_json(meta / "info.json", self._info())
        for folder in ("levels", "facts"):
            shutil.rmtree(self.root / folder, ignore_errors=True)
        if card is not None:
            (self.root / "README.md").write_text(card)
        size = sum(path.stat().st_size for path in self.root.rglob("*") if path.is_file())
        self.root.rename(self.out)
        return {"dataset": str(self.out), "episodes": len(self.rows), "frames": self.frames, "bytes": size}

    def abandon(self, keep_finished: bool = False) -> None:
        """Ends without a data set. Nothing of it is left, but for finished files if they are to be kept."""
        for video in self._videos.values():
            video.abandon()
        if not keep_finished or self._file == 0:
            shutil.rmtree(self.root, ignore_errors=True)
            return
        for key in self._videos:
            self._path(f"videos/{key}", "mp4").unlink(missing_ok=True)

    def _resume(self) -> None:
        found = json.loads((self.root / FILE).read_text())
        if found != json.loads(json.dumps(self._state)):
            names = [name for name in self._state if found.get(name) != json.loads(json.dumps(self._state[name]))]
            raise ValueError(
                f"{self.root}: found an incomplete data set with another {' and '.join(names)}, expected the same, or no such folder"
            )
        while (path := self._path("meta/episodes", number=self.resumed)).exists():
            self.rows += tables.read_episodes(path)
            self.resumed += 1

    def _path(self, folder: str, suffix: str = "parquet", number: int | None = None) -> Path:
        number = self._file if number is None else number
        path = self.root / folder / f"chunk-{number // tables.FILES:03d}/file-{number % tables.FILES:03d}.{suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def _first_of(self, number: int) -> int:
        """Index of the first frame in a file."""
        place = (number // tables.FILES, number % tables.FILES)
        return int(next(row["dataset_from_index"] for row in self.rows if (row["data/chunk_index"], row["data/file_index"]) == place))

    def _checked(self, episode: Episode) -> int:
        """Number of steps, if all shapes are as the layout says."""
        count = len(episode.vectors[ACTION]) if ACTION in episode.vectors else 0
        if count == 0:
            raise ValueError(f"episode.{ACTION}: found no step, expected at least one")
        rewards = "next.reward" in self._columns
        if rewards != (episode.reward is not None):
            raise ValueError(f"episode.reward: found {'none' if rewards else 'some'}, expected {'some' if rewards else 'none'}")
        expected: dict[str, tuple[int, ...]] = {name: (count, len(names)) for name, names in self.layout.names().items()}
        expected |= {key: (count, side, side, 3) for key, side in self.layout.sides().items()}
        for name, shape in expected.items():
            array = episode.vectors.get(name, episode.images.get(name))
            if array is None or array.shape != shape:
                raise ValueError(f"episode.{name}: found {'none' if array is None else array.shape}, expected shape {shape}")
        return count

    def _statistics(self) -> dict[str, Any]:
        """Statistics of all episodes, exact."""
        files = [n for n in range(self._file) if self._path("data", number=n).exists()]
        found = {name: statistics.of_vectors(tables.read_column([self._path("data", number=n) for n in files], name)) for name in self._columns}
        for key in self.layout.sides():
            counts = np.zeros((3, 256), dtype=np.int64)
            for number in files:
                with np.load(self._path("levels", "npz", number)) as kept:
                    counts += kept[key]
            found[key] = statistics.of_levels(counts, self.frames)
        return found

    def _info(self) -> dict[str, Any]:
        return tables.info(
            {STATE: [], ENVIRONMENT: []} | self.layout.names(),
            self.layout.sides(),
            self.video,
            [*FLAGS, *(["next.reward"] if "next.reward" in self._columns else [])],
            robot=self.robot,
            episodes=len(self.rows),
            frames=self.frames,
            tasks=len(self._tasks),
        )
