"""Tables and JSON files of a data set, as LeRobot's format v3.0 has them."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftac.lerobot import video
from ftac.lerobot.video import FPS, Quality

DATA_MB, VIDEO_MB, FILES = 100, 200, 1000
"""Sizes of files that are added later, MB, and the number of files in a folder."""
DTYPES = {"timestamp": "float32", "next.reward": "float32", "next.done": "bool", "next.success": "bool"}
"""Types of single numbers; all others are int64."""


def require() -> None:
    """``ImportError`` if a package is missing."""
    try:
        import av  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise ImportError(f"a LeRobot data set needs pyarrow and av ({error}): pip install 'ftac[lerobot]'") from None


def write_data(path: Path, episodes: list[dict[str, NDArray[Any]]], vectors: dict[str, list[str]]) -> None:
    """Writes the frames of episodes: a row group for each episode."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    def table(columns: dict[str, NDArray[Any]]) -> Any:
        found = {}
        for name, values in columns.items():
            if name in vectors:
                found[name] = pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
            else:
                found[name] = pa.array(values.astype(DTYPES.get(name, "int64")))
        return pa.table(found)

    tables = [table(columns) for columns in episodes]
    with pq.ParquetWriter(path, tables[0].schema) as writer:
        for one in tables:
            writer.write_table(one)


def write_episodes(path: Path, rows: list[dict[str, Any]]) -> None:
    """Writes the rows of ``meta/episodes``. The file gets its name when it is complete."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    unnamed = path.with_suffix(".unfinished")
    pq.write_table(pa.Table.from_pylist(rows), unnamed)
    os.replace(unnamed, path)


def read_episodes(path: Path) -> list[dict[str, Any]]:
    """The rows of a table of episodes."""
    import pyarrow.parquet as pq

    return list(pq.read_table(path).to_pylist())


def read_column(paths: list[Path], name: str) -> NDArray[Any]:
    """A column of the frames as rows (n, k)."""
    import pyarrow.parquet as pq

    columns = []
    for path in paths:
        column = pq.read_table(path, columns=[name])[name].combine_chunks()
        values = column.flatten() if hasattr(column, "flatten") and hasattr(column.type, "list_size") else column
        columns.append(np.asarray(values.to_numpy(zero_copy_only=False)).reshape(len(column), -1))
    return np.concatenate(columns)


def remove_empty(folder: Path) -> None:
    """Removes tables of files without episodes."""
    import pyarrow.parquet as pq

    for path in folder.rglob("*.parquet"):
        if pq.read_metadata(path).num_rows == 0:
            path.unlink()


def write_tasks(path: Path, tasks: dict[str, int]) -> None:
    """Writes the tasks, as pandas writes a table whose index is the task's words."""
    import pyarrow as pa
    import pyarrow.parquet as pq

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
    pq.write_table(named.replace_schema_metadata({"pandas": json.dumps(about)}), path)


def write_json(path: Path, value: Any) -> None:
    """Writes JSON as LeRobot does."""
    path.write_text(json.dumps(value, indent=4))


def info(
    vectors: dict[str, list[str]],
    sides: dict[str, int],
    quality: Quality,
    single: list[str],
    *,
    robot: str,
    episodes: int,
    frames: int,
    tasks: int,
) -> dict[str, Any]:
    """The contents of ``meta/info.json``."""
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(names)], "names": names} for name, names in vectors.items()
    }
    features |= {key: video.described(side, quality) for key, side in sides.items()}
    for name in ("timestamp", "frame_index", "episode_index", "index", "task_index", *single):
        features[name] = {"dtype": DTYPES.get(name, "int64"), "shape": [1], "names": None}
    return {
        "codebase_version": "v3.0",
        "robot_type": robot,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": tasks,
        "chunks_size": FILES,
        "data_files_size_in_mb": DATA_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "fps": FPS,
        "splits": {"train": f"0:{episodes}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4" if sides else None,
        "features": features,
    }
