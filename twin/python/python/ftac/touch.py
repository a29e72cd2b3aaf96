"""Heights and normals of the gel from a tactile image, by the built-in photometric calibration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac import _native, hand
from ftac._arrays import image as picture
from ftac._images import beside, coloured, png

Map = NDArray[np.float32]


class Surface(NamedTuple):
    """The gel under a pad. ``indentation`` (240, 240), m, is positive into the gel; ``normals`` (240, 240, 3) are unit vectors out of the surface, pad
    frame. A notebook shows the indentation beside the normals."""

    indentation: Map
    normals: Map

    def __repr__(self) -> str:
        deepest = 1e3 * float(self.indentation.max())
        return f"<Surface: indentation {self.indentation.shape} up to {deepest:.2f} mm, normals {self.normals.shape}>"

    def _repr_png_(self) -> bytes:
        depth = coloured(self.indentation, 0.0, float(self.indentation.max()))
        # A component of a normal from -1 to 1 is a channel from 0 to 255.
        return png(beside(depth, np.rint(127.5 * (self.normals + 1.0)).astype(np.uint8)))

    def points(self, camera: int | str) -> NDArray[np.float64]:
        """The surface as points (57600, 3), m, pad frame."""
        view = hand.CAMERAS[hand.camera(camera)]
        rows, columns = self.indentation.shape
        x = (np.arange(columns) + 0.5) / columns * view.width - 0.5 * view.width
        y = view.center_y + 0.5 * view.height - (np.arange(rows) + 0.5) / rows * view.height
        grid = np.broadcast_arrays(x[None, :], y[:, None], -self.indentation)
        return np.stack([axis.ravel() for axis in grid], axis=1).astype(np.float64)


def surface(camera: int | str, image: ArrayLike, background: ArrayLike) -> Surface:
    """The surface that `camera` sees in `image` against `background`, its image untouched; both (240, 240, 3) uint8.

    Returns a `Surface`: indentation (240, 240) m, normals (240, 240, 3).

    A pad whose image does not differ from its background is flat.
    """
    index = hand.camera(camera)
    heights, gx, gy = _native.heights(index, picture("image", image), picture("background", background))
    normals = np.stack([gx, gy, np.ones_like(gx)], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return Surface(heights, normals)
