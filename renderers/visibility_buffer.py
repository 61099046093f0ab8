"""The visibility buffer: the primitive that each pixel sees and its depth. The rasterizer fills it, shading reads it.

A primitive is one triangle, line or point of one instance. Primitive ids count over the whole draw list: id ``p`` is
primitive ``p - first_ids[i]`` of instance ``i`` where ``first_ids[i] <= p < first_ids[i + 1]``
(``renderers.primitive_ids``). They depend on the draw list only, not on camera, selection or threads.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList

BAND_ROWS: Final = 32
"""Rows of a band, the unit of work of rasterization and shading: 32 rows x 1280 pixels x 8 bytes fit the L2 cache."""


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """One layer of visible surfaces."""

    ids: NDArray[np.int32]
    """(H, W) int32, C-contiguous: id of the primitive that the pixel sees; -1: none."""
    inv_z: NDArray[np.float32]
    """(H, W) float32, C-contiguous: 1 / (distance along the optical axis), 1/m; undefined where ``ids`` is -1."""
    first_ids: NDArray[np.int64]
    """(I + 1,) int64: first primitive id of every instance of the draw list; the last value is the number of ids."""
    X_camera_mesh: NDArray[np.float64]
    """(I, 4, 4) float64, C-contiguous: transforms from each instance's mesh frame to the camera's optical frame.

    For a triangle whose vertices are the columns of ``P = [p0 p1 p2]`` in the optical frame and the pixel's ray
    ``d = ((i + 0.5 - cx) / fx, (j + 0.5 - cy) / fy, 1)``, ``b / z = P^-1 d`` gives the perspective-correct
    barycentric coordinates ``b`` after division by their sum ``1 / z`` (also for triangles that cross the near plane).
    """


@dataclass(frozen=True, slots=True, eq=False)
class SampledView:
    """View of a scene with several samples per pixel: the tables that all bands share."""

    first_ids: NDArray[np.int64]
    """As in ``Visibility``."""
    X_camera_mesh: NDArray[np.float64]
    """As in ``Visibility``."""


@dataclass(frozen=True, slots=True, eq=False)
class SampledShader:
    """Shading of bands with several samples per pixel."""

    kernel: int
    """Address of a kernel that any thread calls with five int64: ``job``, the address of a ``msaa.SampleBand``, the
    values from one of its rows to the next, its first row in the image, and the row after its last."""
    job: int
    """First argument of the kernel."""
    keep: object
    """Objects that must live as long as bands are shaded."""


class Rasterizer(Protocol):
    """Source of further visibility layers and of threads for shading. ``CpuRenderer`` implements it."""

    def visibility(
        self,
        scene: DrawList,
        camera: Camera,
        *,
        select: NDArray[np.bool_] | None = None,
        cull_back: NDArray[np.bool_] | None = None,
        behind: Visibility | None = None,
        in_front_of: Visibility | None = None,
        id_limits: NDArray[np.int32] | None = None,
        latest: bool = False,
    ) -> Visibility:
        """Return the nearest surface of every pixel. At equal depth, the higher primitive id wins.

        Args:
            select: (I,) bool; only these instances are drawn. None: all.
            cull_back: (I,) bool; triangles of these instances that face away from the camera are not drawn. The
                front is the side from which a triangle's vertices run counter-clockwise in the mesh's own frame,
                so a mirrored instance keeps its fronts. None: both sides are drawn.
            behind: layer; only surfaces strictly behind it, by depth and then by id, are drawn (depth peeling). Where
                the layer sees nothing, nothing is drawn.
            in_front_of: layer of other instances, as if drawn first; surfaces behind it are not drawn, those at the
                same depth are. Where the layer sees nothing, all are.
            id_limits: (H, W) int32, ids; only primitives with lower ids than these are drawn.
            latest: return the surface with the highest id instead of the nearest one; ``inv_z`` is undefined then.
        """
        ...

    def shade_samples(
        self,
        scene: DrawList,
        camera: Camera,
        samples: int,
        make_shader: Callable[[SampledView], SampledShader],
        *,
        select: NDArray[np.bool_] | None = None,
        cull_back: NDArray[np.bool_] | None = None,
    ) -> None:
        """Rasterize 4 or 8 samples of every pixel, and shade each band while it is in the cache.

        Args:
            make_shader: called once, before the first band.
            select, cull_back: as in ``visibility``.
        """
        ...

    def parallel(self, units: int, work: Callable[[int], object]) -> None:
        """As ``Renderer.parallel``. For pixels, ``units`` is ``band_count(height)``; unit ``u`` begins at row
        ``u * BAND_ROWS``.
        """
        ...


def band_count(height: int) -> int:
    """Return the number of bands of an image of ``height`` rows; the last may be shorter."""
    return -(-height // BAND_ROWS)
