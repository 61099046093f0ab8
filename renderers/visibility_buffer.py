"""What shading works from: which element each pixel sees, and how deep it is.

A *record* is one element (triangle, line or point) of one instance. Records are numbered over the whole draw list:
record ``r`` is element ``r - first_record[i]`` of instance ``i`` where ``first_record[i] <= r < first_record[i + 1]``
(``renderers.primitive_ids``). The numbers depend on the draw list only, not on camera, selection or threads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList

BAND_ROWS: Final = 32
"""Rows of a band, the unit of work of raster, resolve and shading: 32 rows x 1280 pixels x 8 bytes stay in the L2."""


@dataclass(slots=True, eq=False)
class Visibility:
    """One layer of visible surfaces. The arrays are pooled: ``close`` when done with them."""

    ids: NDArray[np.int32]
    """(H, W) int32, C-contiguous: the record that the pixel sees, -1 where it sees none."""
    inv_z: NDArray[np.float32]
    """(H, W) float32, C-contiguous: 1 / (distance along the optical axis), 1/m; not meaningful where ``ids`` is -1."""
    first_record: NDArray[np.int64]
    """(I + 1,) int64: the first record of every instance of the draw list, and the number of records at the end."""
    X_camera_mesh: NDArray[np.float64]
    """(I, 4, 4) float64, C-contiguous: from each instance's mesh frame to the camera's optical frame.

    For a triangle whose vertices are the columns of ``P = [p0 p1 p2]`` in the optical frame and the pixel's ray
    ``d = ((i + 0.5 - cx) / fx, (j + 0.5 - cy) / fy, 1)``, ``b / z = P^-1 d`` gives the perspective-correct
    barycentric coordinates ``b`` after division by their sum ``1 / z`` (also for triangles that cross the near plane).
    """
    _release: Callable[[], None] | None = field(default=None, repr=False)

    def close(self) -> None:
        """Hand the pixel arrays back to the pool; calling it again does nothing."""
        release, self._release = self._release, None
        if release is not None:
            release()

    def __enter__(self) -> Visibility:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


@dataclass(frozen=True, slots=True, eq=False)
class SampledView:
    """What is the same in all bands of a picture with several samples a pixel."""

    first_record: NDArray[np.int64]
    """As in ``Visibility``."""
    X_camera_mesh: NDArray[np.float64]
    """As in ``Visibility``."""
    stride: int
    """Values from one row of a band's records to the next."""


@dataclass(frozen=True, slots=True, eq=False)
class SampledShader:
    """What is done with a band whose samples' records are known."""

    kernel: int
    """Address of a kernel of five int64: ``job``, the address of the band's ``samples.E_COLUMNS`` int64, the view's
    stride, and the band's first row of the picture and the one after its last. Called from any thread."""
    job: int
    keep: object
    """What lives as long as bands are shaded."""


class Rasterizer(Protocol):
    """What shading asks for more layers and for threads. ``CpuRenderer`` gives one per render call."""

    def visibility(
        self,
        scene: DrawList,
        camera: Camera,
        *,
        select: NDArray[np.bool_] | None = None,
        cull_back: NDArray[np.bool_] | None = None,
        beyond: Visibility | None = None,
        before: Visibility | None = None,
    ) -> Visibility:
        """The nearest surface of every pixel; of two at the same depth, the one with the lower record number.

        Args:
            select: (I,) bool; only these instances are drawn. None: all.
            cull_back: (I,) bool; triangles of these instances that face away from the camera are not drawn. The
                front is the side from which the element's vertices run counter-clockwise in the mesh's own frame,
                so a mirrored instance keeps its fronts. None: both sides are drawn.
            beyond: only what lies strictly behind this layer, ordered by depth and then by record (depth peeling).
                Where that layer sees nothing, nothing is drawn.
            before: only what lies strictly in front of this layer. Where that layer sees nothing, everything is.
        """
        ...

    def sampled(
        self,
        scene: DrawList,
        camera: Camera,
        samples: int,
        begin: Callable[[SampledView], SampledShader],
        *,
        cull_back: NDArray[np.bool_] | None = None,
    ) -> None:
        """Find out what 4 or 8 samples of every pixel see, band by band, while a band is in the cache.

        Args:
            begin: called once; says what is called for every band.
            cull_back: as in ``visibility``.
        """
        ...

    def parallel(self, units: int, work: Callable[[int], object]) -> None:
        """Call ``work(0) .. work(units - 1)`` from the calling thread and whichever helpers are free, in any order.

        ``work`` should spend its time in nogil kernels; its first exception is raised here after all have ended.
        For pixels, ``units`` is ``band_count(height)`` and unit ``u`` the rows ``u * BAND_ROWS`` and on.
        """
        ...


def band_count(height: int) -> int:
    """Number of bands of an image of ``height`` rows; the last may be shorter."""
    return -(-height // BAND_ROWS)
