"""Colour image of the headlight looks: the layers it needs, shaded band by band."""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.pointers import Table, address_of, table
from renderers.compiler.simd import LANES
from renderers.drawlist import DrawList
from renderers.interface import Look
from renderers.shading.depth_peeling import MAX_LAYERS, peeled
from renderers.shading.gamma import ENCODED, GAMMA_CELLS
from renderers.shading.headlight.layout import S_COLUMNS
from renderers.shading.headlight.output_merge import DIRECT, GATHER, UNDER
from renderers.shading.headlight.shade_rows import shade_rows
from renderers.shading.layout import P_COLUMNS
from renderers.shading.scene import ShadingScene, map_instances

if TYPE_CHECKING:  # the rasterizer imports this module
    from renderers.visibility_buffer import Rasterizer, Visibility

_NOTHING: Final = np.zeros((4, 0, LANES), dtype=np.float32)
_NO_COLOR: Final = np.zeros((0, 0, 3), dtype=np.uint8)
_MAPS: Final = S_COLUMNS + 4
"""Offset of the instances' maps in a painter's memory, in values of 8 bytes: after the job and the lens."""
_JOB: Final = Struct(f"{S_COLUMNS}q4d")
_GAMMA: Final = address_of(GAMMA_CELLS, np.int32), address_of(ENCODED, np.float32)


def paint(
    rasterizer: Rasterizer,
    scene: DrawList,
    shading: ShadingScene,
    camera: Camera,
    look: Look,
    color: NDArray[np.uint8],
    *,
    first: Visibility | None = None,
    max_layers: int = MAX_LAYERS,
) -> None:
    """Render the colour image.

    Opaque instances take one visibility buffer. Transparent ones are peeled in front of it, nearest first, and blended
    front to back in the colour space of the stored image, as RenderEngineVtk does. The opaque image and the background
    come beneath; each pixel is rounded once.

    Args:
        rasterizer: renders visibility and runs bands.
        scene: the draw list that ``shading`` was prepared from, with ``look.name``.
        color: (H, W, 3) uint8, C-contiguous; every pixel is written.
        first: visibility of the whole scene with both faces, if there is one already (for depth or label). It is used
            if colour needs the same, and never changed or closed.
        max_layers: as for ``peeled``.
    """
    cull = shading.cull_back if shading.culls else None
    if not shading.has_transparency:
        if first is not None and cull is None:
            _shade(rasterizer, shading, first, camera, look, DIRECT, _NOTHING, color)
            return
        with rasterizer.visibility(scene, camera, cull_back=cull) as seen:
            _shade(rasterizer, shading, seen, camera, look, DIRECT, _NOTHING, color)
        return
    with rasterizer.visibility(scene, camera, select=~shading.transparent, cull_back=cull) as behind:
        gathered = np.zeros((4, camera.height, camera.width + LANES), dtype=np.float32)
        gathered[3] = 1.0
        any_layer = False
        for layer in peeled(rasterizer, scene, shading, camera, cull, behind, max_layers):
            any_layer = True
            _shade(rasterizer, shading, layer, camera, look, GATHER, gathered, _NO_COLOR)
            # Nothing can be seen behind an opaque texel: no more layers there.
            layer.ids[gathered[3, :, : camera.width] <= 0.0] = -1
        _shade(rasterizer, shading, behind, camera, look, UNDER if any_layer else DIRECT, gathered, color)


class Painter:
    """Shades bands of one view. Immutable, thread-safe."""

    def __init__(
        self,
        shading: ShadingScene,
        places: tuple[int, int, int, int],
        camera: Camera,
        look: Look,
        *,
        mode: int = DIRECT,
        gathered: int = 0,
        table: Callable[[int], Table] = table,
        keep: object = None,
    ) -> None:
        """
        Args:
            places: addresses of ``first_ids`` and ``X_camera_mesh`` as in ``Visibility``, address of the image,
                (H, W, 3) uint8, and number of values from one row of records to the next.
            mode: of ``output_merge``. gathered: address of its layers.
            table: allocates working memory, which must not be used otherwise while this object is alive.
            keep: objects that the addresses point into.
        """
        if shading.look != look.name:
            raise ValueError(f"the scene was prepared for the look {shading.look!r}, not {look.name!r}")
        first_record, meshes, color, stride = places
        self.height = camera.height
        count = len(shading.cull_back)
        red, green, blue = look.background
        # One array for the job, the lens and the maps.
        own, memory, address = table(_MAPS + (count * P_COLUMNS + 1) // 2)
        _JOB.pack_into(
            memory,
            0,
            first_record,
            count,
            meshes,
            address + 8 * _MAPS,
            address + 8 * S_COLUMNS,
            *shading.job,
            look.name == "pbr",
            mode,
            camera.width,
            camera.height,
            stride,
            *_GAMMA,
            red | green << 8 | blue << 16,
            gathered,
            color,
            0,
            0,
            camera.fx,
            camera.fy,
            camera.cx,
            camera.cy,
        )
        map_instances(meshes, address + 8 * _MAPS, count)
        self.job = address
        """Address of S_COLUMNS int64. Valid while this object is alive."""
        self._keep = (shading, own, keep)

    @classmethod
    def of(
        cls,
        shading: ShadingScene,
        X_camera_mesh: NDArray[np.float64],
        first_record: NDArray[np.int64],
        camera: Camera,
        look: Look,
        color: NDArray[np.uint8],
        *,
        stride: int,
        mode: int = DIRECT,
        gathered: NDArray[np.float32] = _NOTHING,
    ) -> Painter:
        """Create a painter from arrays.

        Args:
            X_camera_mesh, first_ids: as in ``Visibility``.
            color: (H, W, 3) uint8, C-contiguous.
            stride: number of values from one row of records to the next.
            mode, gathered: of ``output_merge``.
        """
        return cls(
            shading,
            (
                address_of(first_record, np.int64),
                address_of(X_camera_mesh, np.float64),
                address_of(color, np.uint8),
                stride,
            ),
            camera,
            look,
            mode=mode,
            gathered=address_of(gathered, np.float32),
            keep=(X_camera_mesh, first_record, color, gathered),
        )

    def band(self, band: int, ids: int) -> None:
        """Shade one band.

        Args:
            ids: address of the record of the image's first pixel. Only the band's records are read.
        """
        from renderers.visibility_buffer import BAND_ROWS

        begin = band * BAND_ROWS
        shade_rows(self.job, ids, begin, min(begin + BAND_ROWS, self.height))


def _shade(
    rasterizer: Rasterizer,
    shading: ShadingScene,
    seen: Visibility,
    camera: Camera,
    look: Look,
    mode: int,
    gathered: NDArray[np.float32],
    color: NDArray[np.uint8],
) -> None:
    """Shade all bands."""
    from renderers.visibility_buffer import band_count

    painter = Painter.of(
        shading,
        seen.X_camera_mesh,
        seen.first_ids,
        camera,
        look,
        color,
        stride=camera.width,
        mode=mode,
        gathered=gathered,
    )
    ids = address_of(seen.ids, np.int32)
    rasterizer.parallel(band_count(camera.height), lambda unit: painter.band(unit, ids))
