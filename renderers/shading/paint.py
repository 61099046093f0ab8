"""The colour picture of a view: which layers are needed, and shading them band by band."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.port import Look
from renderers.shading.compose import DIRECT, GATHER, UNDER
from renderers.shading.kernels import shade_rows
from renderers.shading.sampling import BYTE_VALUES
from renderers.shading.scene import ShadingScene, normal_matrices
from renderers.shading.transfer import DECODED, GUESSES, THRESHOLDS

if TYPE_CHECKING:  # the rasterizer calls this module
    from renderers.cpu.visibility import Rasterizer, Visibility

MAX_LAYERS: Final = 32
"""Default bound of translucent and cut-out surfaces drawn behind one another in a pixel, nearest first: each costs one
more pass over the translucent instances, and a hostile scene could stack millions. Behind 32 layers of opacity 0.2
less than a thousandth of the light is left; what lies deeper is not drawn."""

_NOTHING: Final = np.zeros((0, 0, 4), dtype=np.float32)
_NO_COLOR: Final = np.zeros((0, 0, 3), dtype=np.uint8)


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
    """Draws the colour picture.

    Opaque instances are seen through one visibility buffer. Translucent and cut-out ones are peeled in front of it,
    nearest first, each pixel's layers composited front to back as bytes would be shown (RenderEngineVtk blends what it
    shows, not linear light); the opaque picture and the background come beneath, and are rounded once.

    Args:
        rasterizer: gives visibility and runs bands.
        scene: what is drawn; ``shading`` must be prepared from its instances with ``look.name``.
        color: (H, W, 3) uint8, C-contiguous; every pixel is written.
        first: visibility of the whole scene with both faces of everything, if there is one anyway (for depth or
            label); used where it is just what colour needs, never changed or closed here.
        max_layers: see ``MAX_LAYERS``.
    """
    if shading.look != look.name:
        raise ValueError(f"the scene was prepared for the look {shading.look!r}, not {look.name!r}")
    cull = shading.cull_back if shading.cull_back.any() else None
    if not shading.translucent:
        if first is not None and cull is None:
            _shade(rasterizer, shading, first, camera, look, DIRECT, _NOTHING, color)
            return
        with rasterizer.visibility(scene, camera, cull_back=cull) as seen:
            _shade(rasterizer, shading, seen, camera, look, DIRECT, _NOTHING, color)
        return
    with rasterizer.visibility(scene, camera, select=~shading.layered, cull_back=cull) as behind:
        gathered = np.zeros((camera.height, camera.width, 4), dtype=np.float32)
        gathered[..., 3] = 1.0
        any_layer = False
        beyond: Visibility | None = None
        try:
            for _ in range(max_layers):
                layer = rasterizer.visibility(
                    scene, camera, select=shading.layered, cull_back=cull, beyond=beyond, before=behind
                )
                if beyond is not None:
                    beyond.close()
                beyond = layer
                if not (layer.ids >= 0).any():
                    break
                any_layer = True
                _shade(rasterizer, shading, layer, camera, look, GATHER, gathered, _NO_COLOR)
                # Nothing can be seen behind an opaque texel: no more layers there.
                layer.ids[gathered[..., 3] <= 0.0] = -1
        finally:
            if beyond is not None:
                beyond.close()
        _shade(rasterizer, shading, behind, camera, look, UNDER if any_layer else DIRECT, gathered, color)


def _frame(seen: Visibility, camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Maps of points and normals, at least one each, and the intrinsics."""
    X = seen.X_camera_mesh if len(seen.X_camera_mesh) else np.eye(4)[None]
    return X, normal_matrices(X), np.array((camera.fx, camera.fy, camera.cx, camera.cy), dtype=np.float64)


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
    """Runs ``shade_rows`` over all bands."""
    from renderers.cpu.visibility import BAND_ROWS, band_count

    X, N, intrinsics = _frame(seen, camera)
    background = np.array(look.background, dtype=np.uint8)

    def band(unit: int) -> None:
        begin = unit * BAND_ROWS
        shade_rows(
            look.name == "pbr",
            mode,
            seen.ids,
            seen.first_record,
            X,
            N,
            intrinsics,
            shading.instances,
            shading.material_integers,
            shading.material_floats,
            shading.texture_integers,
            shading.texture_floats,
            BYTE_VALUES,
            DECODED,
            THRESHOLDS,
            GUESSES,
            background,
            begin,
            min(begin + BAND_ROWS, camera.height),
            gathered,
            color,
        )

    rasterizer.parallel(band_count(camera.height), band)
