"""Rendering of the colour image in the headlight looks: its layers, shaded band by band."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.pointers import address_of
from renderers.compiler.simd import LANES
from renderers.drawlist import DrawList
from renderers.interface import VTK_LOOKS, Frame, Look
from renderers.shading.camera_light import CameraLightJob
from renderers.shading.depth_peeling import for_bands, peeled, surfaces_in_drawing_order
from renderers.shading.gamma import GAMMA_CELLS, GAMMA_FROM_LINEAR
from renderers.shading.headlight.layout import DIRECT, GATHER, UNDER, HeadlightInputs
from renderers.shading.headlight.shade_rows import shade_rows
from renderers.shading.scene import ShadingJob, ShadingScene
from renderers.visibility_buffer import Rasterizer, Visibility

_NO_IMAGES: Final = Frame()
_GAMMA_TABLES: Final = address_of(GAMMA_CELLS, np.int32), address_of(GAMMA_FROM_LINEAR, np.float32)


def paint(
    rasterizer: Rasterizer,
    scene: DrawList,
    shading: ShadingScene,
    camera: Camera,
    look: Look,
    color: NDArray[np.uint8] | NDArray[np.uint32],
    frame: Frame = _NO_IMAGES,
) -> None:
    """Render the colour image.

    All opaque instances take one visibility buffer. Other instances are gathered in layers, front to back, in the order
    of ``depth_peeling``. They are blended in the colour space of the stored image, as in RenderEngineVtk. Each pixel is
    rounded once.

    Args:
        shading: prepared from the scene's instances for ``look.name``.
        color: (H, W, 3), C-contiguous, or ``frame.roots``; every pixel is written.
        frame: its ``lamp_share``, ``key_factor`` and ``light`` are filled, of the opaque surfaces.
    """
    cull_back, transparent, blended = shading.cull_back, shading.transparent, shading.blended_in_place
    if not shading.has_transparency:
        visible = rasterizer.visibility(scene, camera, cull_back=cull_back)
        _shade(rasterizer, shading, visible, camera, look, DIRECT, None, color, frame)
        return
    gathered = np.zeros((4, camera.height, camera.width + LANES), dtype=np.float32)
    gathered[3] = 1.0
    transmittance = gathered[3, :, : camera.width]
    has_layers, in_drawing_order = False, look.name in VTK_LOOKS
    behind = rasterizer.visibility(scene, camera, select=~transparent, cull_back=cull_back)
    if transparent.any():
        for layer in peeled(
            rasterizer, scene, camera, transparent, cull_back, behind, in_drawing_order=in_drawing_order
        ):
            has_layers = True
            _shade(rasterizer, shading, layer, camera, look, GATHER, gathered, None)
            # No more layers where a layer is opaque: nothing is visible behind it.
            layer.ids[transmittance <= 0.0] = -1
    if blended.any():
        for layer in surfaces_in_drawing_order(rasterizer, scene, camera, blended, cull_back, behind, transmittance):
            has_layers = True
            _shade(rasterizer, shading, layer, camera, look, GATHER, gathered, None)
        behind = rasterizer.visibility(scene, camera, select=~(transparent | blended), cull_back=cull_back)
    _shade(rasterizer, shading, behind, camera, look, UNDER if has_layers else DIRECT, gathered, color, frame)


def solid_pixels(
    rasterizer: Rasterizer, shading: ShadingScene, look: Look, layer: Visibility, camera: Camera
) -> NDArray[np.bool_]:
    """Return a mask of the pixels where a layer is not cut out and has at least ``look.alpha_threshold``, (H, W)."""
    gathered = np.zeros((4, camera.height, camera.width + LANES), dtype=np.float32)
    gathered[3] = 1.0
    _shade(rasterizer, shading, layer, camera, look, GATHER, gathered, None)
    transmittance = gathered[3, :, : camera.width]
    one = np.float32(1.0)
    return (transmittance < one) & (transmittance <= one - np.float32(look.alpha_threshold))


class HeadlightJob:
    """The HeadlightInputs of an image or layer. Immutable, thread-safe. The addresses given to it must outlive it."""

    def __init__(
        self,
        shading: ShadingScene,
        camera: Camera,
        look: Look,
        *,
        first_ids: int,
        X_camera_mesh: int,
        stride: int,
        color: int,
        mode: int = DIRECT,
        gathered: int = 0,
        frame: Frame = _NO_IMAGES,
    ) -> None:
        """
        Args:
            first_ids, X_camera_mesh: addresses of the arrays of these names in ``Visibility``.
            stride: number of values from one row of primitive ids to the next.
            color: address of the image, (H, W, 3) uint8, or of ``frame.roots``.
        """
        if shading.look != look.name:
            raise ValueError(f"the scene was prepared for the look {shading.look!r}, not {look.name!r}")
        light = CameraLightJob(look.camera_light, camera) if look.camera_light is not None else None
        has_key = look.camera_light is not None and look.camera_light.key is not None
        shading_job = ShadingJob(
            shading, camera, first_ids, X_camera_mesh, area_filter=look.area_filter, reads_positions=light is not None
        )
        job = np.empty(1, HeadlightInputs.dtype)
        red, green, blue = look.background
        job[0] = HeadlightInputs.record(
            shading=shading_job.address,
            mode=mode,
            width=camera.width,
            height=camera.height,
            stride=stride,
            background=red | green << 8 | blue << 16,
            color=color,
            has_roots=frame.roots is not None,
            gathered=gathered,
            gamma_cells=_GAMMA_TABLES[0],
            gamma_from_linear=_GAMMA_TABLES[1],
            has_camera_light=light is not None,
            lamp_share=address_of(frame.lamp_share, np.float32),
            key_factor=address_of(frame.key_factor, np.float32) if has_key else 0,
            light=address_of(frame.light, np.float32) if light is not None else 0,
            camera_light=light.address if light is not None else 0,
        )
        self.address = address_of(job, HeadlightInputs.dtype)
        """Valid while this object is alive."""
        self._keep = (shading_job, light, job)


def _shade(
    rasterizer: Rasterizer,
    shading: ShadingScene,
    visible: Visibility,
    camera: Camera,
    look: Look,
    mode: int,
    gathered: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | NDArray[np.uint32] | None,
    frame: Frame = _NO_IMAGES,
) -> None:
    """Shade all bands of a layer."""
    job = HeadlightJob(
        shading,
        camera,
        look,
        first_ids=address_of(visible.first_ids, np.int64),
        X_camera_mesh=address_of(visible.X_camera_mesh, np.float64),
        stride=camera.width,
        color=0 if color is None else address_of(color, color.dtype),
        mode=mode,
        gathered=address_of(gathered, np.float32),
        frame=frame,
    )

    def shade(begin: int, end: int) -> None:
        shade_rows(job.address, address_of(visible.ids[begin:], np.int32), begin, end)

    for_bands(rasterizer, camera.height, shade)
