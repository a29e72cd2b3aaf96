"""Videos of a data set: H.264 in MP4, which LeRobot's decoders (PyAV, torchcodec) read.

``lossless`` keeps every value of every image (libx264rgb with constant rate factor 0). A number is a constant rate factor of H.264 in full colour resolution
(yuv444p); `measured_loss` states what it loses.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

FPS = 20
CONTACT = 6
"""Change of an image that counts as one by a contact, grey levels: more than the noise of the cameras."""
GROUP = 10
"""Frames from one that stands alone to the next."""
Quality = int | Literal["lossless"]


def quality_of(quality: Any) -> Quality:
    """`quality` if it is ``lossless`` or a constant rate factor from 1 to 40. ``ValueError`` otherwise."""
    if quality == "lossless":
        return "lossless"
    if isinstance(quality, bool) or not isinstance(quality, int) or not 1 <= quality <= 40:
        raise ValueError(f"video: found {quality!r}, expected lossless or a whole number from 1 to 40")
    return quality


class Video:
    """One camera's frames, episode after episode. A file without its final name is incomplete."""

    def __init__(self, path: Path, side: int, quality: Quality) -> None:
        import av

        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = av.open(str(path), "w", format="mp4")
        lossless = quality == "lossless"
        options = {"crf": "0" if lossless else str(quality), "g": str(GROUP), "bf": "0", "preset": "veryfast"}
        self._stream: Any = self._file.add_stream("libx264rgb" if lossless else "libx264", rate=FPS, options=options)
        self._stream.width = self._stream.height = side
        self._stream.pix_fmt = "rgb24" if lossless else "yuv444p"
        self._stream.time_base = Fraction(1, FPS)
        self._stream.codec_context.thread_count = 1
        self._count = 0

    def add(self, images: Iterable[NDArray[np.uint8]]) -> None:
        """Adds frames (side, side, 3)."""
        import av

        for image in images:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            frame.pts, frame.time_base = self._count, Fraction(1, FPS)
            self._count += 1
            self._file.mux(self._stream.encode(frame))

    def finish(self) -> None:
        """Completes the file."""
        self._file.mux(self._stream.encode(None))
        self._file.close()

    def abandon(self) -> None:
        """Closes the file as it is."""
        self._file.close()


def read(path: Path) -> NDArray[np.uint8]:
    """All frames of a video, (n, side, side, 3)."""
    import av

    with av.open(str(path)) as file:
        # More threads only wait for each other in pictures as small as these; lossless ones need no conversion.
        file.streams.video[0].codec_context.thread_count = 1
        frames = ((frame, frame.format.name) for frame in file.decode(video=0))
        return np.stack([frame.to_ndarray(format=None if name == "gbrp" else "rgb24") for frame, name in frames])


def measured_loss(images: Mapping[str, NDArray[np.uint8]], quality: Quality) -> dict[str, float]:
    """The mean error of videos of these images (n, side, side, 3), and the signal that they carry, in grey levels: both where a contact changes an image by
    `CONTACT` or more from the first of its video."""
    error, signal, count = 0.0, 0.0, 0
    with tempfile.TemporaryDirectory() as folder:
        for key, taken in images.items():
            path = Path(folder) / f"{key}.mp4"
            film = Video(path, taken.shape[1], quality)
            film.add(taken)
            film.finish()
            change = np.abs(taken.astype(np.int16) - taken[0])
            touched = change >= CONTACT
            error += float(np.abs(read(path).astype(np.int16) - taken)[touched].sum())
            signal, count = signal + float(change[touched].sum()), count + int(touched.sum())
    return {"error": error / max(count, 1), "signal": signal / max(count, 1)}


def described(side: int, quality: Quality) -> dict[str, Any]:
    """A video's entry among the features of ``meta/info.json``."""
    return {
        "dtype": "video",
        "shape": [side, side, 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": side,
            "video.width": side,
            "video.codec": "h264",
            "video.pix_fmt": "gbrp" if quality == "lossless" else "yuv444p",
            "video.is_depth_map": False,
            "video.fps": FPS,
            "video.channels": 3,
            "has_audio": False,
        },
    }
