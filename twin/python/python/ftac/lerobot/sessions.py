"""Recorded sessions as a LeRobot data set (its format v3.0): what ``ftac export lerobot`` runs.

Twenty frames a second:

- ``observation.state`` (13,): angles of the arm's seven joints and of the six servos' outputs, rad; ``observation.velocity``: their speeds, rad/s;
  ``observation.effort``: the joints' torques (N m) and the servos' currents (A).
- ``action`` (13,): what was sent: the arm's set-points (rad), the currents of the five cables' servos (A), and the angle of the opposition's servo (rad).
- ``observation.images.<pad>``: video, an image a pad. A session has images as often as its controller took some; between them they stand still.
- ``next.done`` and ``next.success``: true in an episode's last frame, the latter if the trial was a success.

It needs ``pyarrow`` and ``av``: ``pip install 'ftac[lerobot]'``.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftac import _native, hand
from ftac._arrays import whole

FPS = 20
TICKS = 6
"""Ticks of 1/120 s in a frame."""
CHUNK = "chunk-000/file-000"
DATA_MB, VIDEO_MB, FILES = 100, 200, 1000
"""What the format states of files that are added later: sizes in MB, files in a folder."""
QUALITY, GROUP = "23", 2
"""Of the videos: H.264's constant rate factor, and frames from one that stands alone to the next."""

ARM = [f"arm_{n}" for n in range(1, 8)]
SERVOS = [f"servo_{name}" for name in ("thumb", "index", "middle", "ring", "little", "opposition")]
VECTORS = ("observation.state", "observation.velocity", "observation.effort", "action")
INDICES = ("frame_index", "episode_index", "index", "task_index")


def export(sessions: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str], images: int = 64) -> dict[str, Any]:
    """Writes `sessions` (MCAP) as the data set `out`, a folder that must not exist, with images of `images` x `images` pixels.

    Returns ``dataset``, ``episodes`` and ``frames``. `ValueError` for what is no session; nothing is left then.
    """
    try:
        import av  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise ImportError(f"export lerobot needs pyarrow and av ({error}): pip install 'ftac[lerobot]'") from None
    images = whole("images", images, 16, 240)
    if images % 2:
        raise ValueError(f"images: found {images}, expected an even number of pixels")
    if not sessions:
        raise ValueError("sessions: found none, expected at least one")
    out = Path(out)
    if out.exists():
        raise ValueError(f"{out}: it is there already, expected the name of a new folder")
    partial = out.with_name(out.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    try:
        written = _write(sessions, partial, images)
        partial.rename(out)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return {"dataset": str(out), **written}


def _write(sessions: Sequence[str | os.PathLike[str]], root: Path, side: int) -> dict[str, int]:
    cameras = {f"observation.images.{pad.name}": n for n, pad in enumerate(hand.PADS)}
    videos = {key: _Video(root / "videos" / key / f"{CHUNK}.mp4", side) for key in cameras}
    tasks: dict[str, int] = {}
    columns: dict[str, list[Any]] = {name: [] for name in (*VECTORS, "timestamp", *INDICES, "next.done", "next.success")}
    episodes: list[dict[str, Any]] = []
    robots: set[str] = set()
    total = 0
    for number, path in enumerate(sessions):
        session = _native.session(Path(path), TICKS, side)
        count = len(session["time"])
        if count == 0:
            raise ValueError(f"{path}: found nothing measured, expected a session that began")
        if abs(TICKS * session["tick"] * FPS - 1.0) > 1e-6:
            raise ValueError(f"{path}: found a tick of {session['tick']} s, expected 1/{TICKS * FPS} s")
        robots.add(session["robot"])
        task, success = _told(session)
        index = tasks.setdefault(task, len(tasks))
        rows = {
            "observation.state": np.hstack([session["arm"], session["servos"]]),
            "observation.velocity": np.hstack([session["arm_velocity"], session["servo_velocity"]]),
            "observation.effort": np.hstack([session["arm_torque"], session["servo_current"]]),
            "action": np.hstack([session["arm_goal"], session["servo_goal"]]),
        }
        frames = np.arange(count)
        flat = {
            "timestamp": (frames / FPS).astype(np.float32),
            "frame_index": frames,
            "episode_index": np.full(count, number),
            "index": total + frames,
            "task_index": np.full(count, index),
            "next.done": frames == count - 1,
            "next.success": (frames == count - 1) & success,
        }
        episode: dict[str, Any] = {
            "episode_index": number,
            "tasks": [task],
            "length": count,
            "data/chunk_index": 0,
            "data/file_index": 0,
            "dataset_from_index": total,
            "dataset_to_index": total + count,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        statistics = {name: _statistics(values.astype(np.float32)) for name, values in rows.items()}
        statistics |= {name: _statistics(values[:, None]) for name, values in flat.items()}
        for key, pad in cameras.items():
            pictures = session["tactile"][:, pad]
            videos[key].add(pictures)
            statistics[key] = _picture_statistics(pictures)
            episode |= {
                f"videos/{key}/chunk_index": 0,
                f"videos/{key}/file_index": 0,
                f"videos/{key}/from_timestamp": total / FPS,
                f"videos/{key}/to_timestamp": (total + count) / FPS,
            }
        episode |= {f"stats/{name}/{what}": value for name, all_ in statistics.items() for what, value in all_.items()}
        episodes.append(episode)
        for name, values in {**rows, **flat}.items():
            columns[name].append(values)
        total += count
        print(f"\r{number + 1} of {len(sessions)} sessions", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    for video in videos.values():
        video.finish()
    _tables(root, columns, episodes, tasks)
    statistics = {name: _together([_of(episode, name) for episode in episodes]) for name in (*columns, *cameras)}
    _json(root / "meta/stats.json", statistics)
    _json(root / "meta/info.json", _info("+".join(sorted(robots)), episodes, total, tasks, list(cameras), side))
    return {"episodes": len(episodes), "frames": total}


def _told(session: dict[str, Any]) -> tuple[str, bool]:
    """The task in words, and whether it was done."""
    outcome = json.loads(session["outcome"]) if session["outcome"] else {}
    first, second = (str(outcome.get(name, "")).replace("_", " ") for name in ("first", "second"))
    words = f"pick up the {first}, then the {second} beside it" if first and second else "pick up two objects"
    return words, bool(outcome.get("success", False))


class _Video:
    """One camera's frames, episode after episode."""

    def __init__(self, path: Path, side: int) -> None:
        import av

        path.parent.mkdir(parents=True)
        self._file = av.open(str(path), "w")
        self._stream = self._file.add_stream("libx264", rate=FPS, options={"crf": QUALITY, "g": str(GROUP)})
        self._stream.width = self._stream.height = side
        self._stream.pix_fmt = "yuv420p"
        self._stream.time_base = Fraction(1, FPS)
        self._count = 0

    def add(self, pictures: NDArray[np.uint8]) -> None:
        import av

        for picture in pictures:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
            frame.pts, frame.time_base = self._count, Fraction(1, FPS)
            self._count += 1
            self._file.mux(self._stream.encode(frame))

    def finish(self) -> None:
        self._file.mux(self._stream.encode(None))
        self._file.close()


def _statistics(values: NDArray[Any]) -> dict[str, Any]:
    numbers = values.astype(np.float64)
    return {
        "min": numbers.min(axis=0).tolist(),
        "max": numbers.max(axis=0).tolist(),
        "mean": numbers.mean(axis=0).tolist(),
        "std": numbers.std(axis=0).tolist(),
        "count": [len(numbers)],
    }


def _picture_statistics(pictures: NDArray[np.uint8]) -> dict[str, Any]:
    """By colour, 0 to 1, as (3, 1, 1)."""
    colours = _statistics(pictures.reshape(-1, 3) / 255.0)
    deep = {name: np.reshape(value, (3, 1, 1)).tolist() for name, value in colours.items() if name != "count"}
    return {**deep, "count": [len(pictures)]}


def _of(episode: dict[str, Any], name: str) -> dict[str, Any]:
    return {what: episode[f"stats/{name}/{what}"] for what in ("min", "max", "mean", "std", "count")}


def _together(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Statistics of all episodes from those of each."""
    arrays = {what: np.array([part[what] for part in parts]) for what in ("min", "max", "mean", "std")}
    counts = np.array([part["count"][0] for part in parts], dtype=np.float64)
    weights = (counts / counts.sum()).reshape(-1, *[1] * (arrays["mean"].ndim - 1))
    mean = (weights * arrays["mean"]).sum(axis=0)
    variance = (weights * (arrays["std"] ** 2 + (arrays["mean"] - mean) ** 2)).sum(axis=0)
    return {
        "min": arrays["min"].min(axis=0).tolist(),
        "max": arrays["max"].max(axis=0).tolist(),
        "mean": mean.tolist(),
        "std": np.sqrt(variance).tolist(),
        "count": [int(counts.sum())],
    }


def _tables(
    root: Path, columns: dict[str, list[Any]], episodes: list[dict[str, Any]], tasks: dict[str, int]
) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = {}
    for name, parts in columns.items():
        values = np.concatenate(parts)
        if name in VECTORS:
            flat = pa.array(values.astype(np.float32).ravel())
            table[name] = pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
        else:
            table[name] = pa.array(values.astype(np.int64) if name in INDICES else values)
    data, meta = root / f"data/{CHUNK}.parquet", root / f"meta/episodes/{CHUNK}.parquet"
    for path in (data, meta):
        path.parent.mkdir(parents=True)
    pq.write_table(pa.table(table), data)
    pq.write_table(pa.Table.from_pylist(episodes), meta)
    # As pandas writes a table whose index is the task's words.
    named = pa.table({"task_index": pa.array(tasks.values(), pa.int64()), "task": pa.array(tasks.keys(), pa.string())})
    column = {"metadata": None, "field_name": "task_index", "name": "task_index"}
    about = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            {**column, "pandas_type": "int64", "numpy_type": "int64"},
            {**column, "field_name": "task", "name": "task", "pandas_type": "unicode", "numpy_type": "object"},
        ],
        "pandas_version": "2.2.0",
    }
    pq.write_table(named.replace_schema_metadata({"pandas": json.dumps(about)}), root / "meta/tasks.parquet")


def _info(
    robot: str, episodes: list[Any], total: int, tasks: dict[str, int], cameras: Iterable[str], side: int
) -> dict[str, Any]:
    def one(kind: str) -> dict[str, Any]:
        return {"dtype": kind, "shape": [1], "names": None}

    video = {
        "dtype": "video",
        "shape": [side, side, 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": side,
            "video.width": side,
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": FPS,
            "video.channels": 3,
            "has_audio": False,
        },
    }
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [13], "names": [*ARM, *SERVOS]} for name in VECTORS
    }
    features |= {camera: video for camera in cameras}
    features |= {"timestamp": one("float32")} | {name: one("int64") for name in INDICES}
    features |= {name: one("bool") for name in ("next.done", "next.success")}
    return {
        "codebase_version": "v3.0",
        "robot_type": f"ftac_gen3_{robot}",
        "total_episodes": len(episodes),
        "total_frames": total,
        "total_tasks": len(tasks),
        "chunks_size": FILES,
        "data_files_size_in_mb": DATA_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "fps": FPS,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        "features": features,
    }


def _json(path: Path, value: Any) -> None:
    path.write_text(json.dumps(value, indent=1))


def main() -> None:
    """``python -m ftac.lerobot OUT SIDE SESSION...``: prints what was written as JSON."""
    out, side, *sessions = sys.argv[1:]
    try:
        print(json.dumps(export(sessions, out, int(side))))
    except (ImportError, OSError, ValueError) as error:
        sys.exit(f"ftac: {error}")


if __name__ == "__main__":
    main()
