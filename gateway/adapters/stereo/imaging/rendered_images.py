"""Make the images and the depth of a frame, in worker threads."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import METERING_DIVISOR, StereoConfig
from gateway.adapters.stereo.device.stream_settings import StreamSettings
from gateway.adapters.stereo.imaging.extra_renderings import blur_motion, key_light, light_of_projectors
from gateway.adapters.stereo.imaging.matched_depth import matched_depth
from gateway.adapters.stereo.imaging.scene_motion import motion_since
from gateway.adapters.stereo.imaging.scene_view import Capture
from renderers.camera import Camera
from renderers.drawlist import ImageError
from renderers.interface import Frame, Look, Output, Renderer
from renderers.light_rig import KeyLight
from renderers.stereo.depth.depth_images import DepthImages, exact_images, true_disparity
from renderers.stereo.depth.filters import apply_filters
from renderers.stereo.depth.matching import ImagePair
from renderers.stereo.light.scene_light import camera_light
from renderers.stereo.model import StereoModel
from renderers.stereo.sensor.camera_image import (
    LENS_BLUR,
    Lens,
    NoiseStream,
    SceneLight,
    SensorImage,
    fixed_pattern,
    frame_key,
    image_from_light,
    light_on_sensor,
    relative_light,
)
from renderers.stereo.sensor.exposure import Exposure, auto_exposure

GREY: Final = False
"""An image of a camera with one channel."""
COLOR: Final = True
"""An image of a camera in RGB."""
DOT_ALPHA: Final = 0.5
"""Alpha below which a matcher and the projector's dots reach what is behind a blended surface."""


@dataclass(frozen=True, slots=True)
class ImageRequest:
    """Images to make from one rendering of one camera."""

    exposure: Exposure
    stream: NoiseStream
    """Stream of random numbers for the noise; it also selects the left or right camera."""
    colors: frozenset[bool]
    """Images to make: ``COLOR``, ``GREY`` or both."""
    averaged_images: int = 1
    """Number of images to average, which reduces the noise."""
    key_light: KeyLight | None = None
    """``MeteredExposure.key_light``; None: it is made again."""


@dataclass(frozen=True, slots=True)
class MeteredExposure:
    """Result of automatic exposure."""

    exposure: Exposure
    brightness: float
    """Mean of the exposed image, 0 to 1."""
    out1_reduction: float = 0.0
    """See ``choose_exposure``."""
    key_light: KeyLight | None = None
    """See ``Imaging.key_light``."""


@dataclass(frozen=True, slots=True, eq=False)
class ColorImage:
    """Image of a colour camera."""

    sensor_image: SensorImage
    exposure: Exposure


@dataclass(slots=True)
class ExposureMemory:
    """State of automatic exposure between frames."""

    out1_high: Exposure | None = None
    """Exposure of the last image with Out1 high."""


@dataclass(frozen=True, eq=False)
class Imaging:
    """Source of images and depth: the rendered scene, with the effects of ``config.realism`` on images."""

    config: StereoConfig
    renderer: Renderer
    exposure_memory: ExposureMemory = field(default_factory=ExposureMemory)
    """State of automatic exposure."""

    @cached_property
    def look(self) -> Look:
        """Look of the rendered images, depth and labels."""
        config = self.config
        return Look(config.look, config.background, alpha_threshold=config.alpha_threshold, area_filter=True)

    @cached_property
    def _solid_look(self) -> Look:
        """Look of ``render_lit``."""
        return replace(self.look, alpha_threshold=max(self.look.alpha_threshold, DOT_ALPHA))

    def lit(self, look: Look, capture: Capture, key: KeyLight | None = None) -> Look:
        """Return a look with the light of a capture. The lamp is half-way between the cameras, as the projector is."""
        config = self.config
        lamp = capture.X_world_left[:3, 3] + config.model.baseline / 2 * capture.X_world_left[:3, 0]
        lights = config.rig.lights_of(capture.scene)
        light = camera_light(config.light, lamp, lights, has_key_light="shadows" in config.realism)
        return replace(look, camera_light=replace(light, key=key))

    def key_light(self, capture: Capture, camera: Camera | None = None) -> KeyLight | None:
        """Return the key light of a capture's images, if they have one. ``camera`` None: the left one, for both."""
        if "shadows" not in self.config.realism:
            return None
        camera = camera or self.camera(capture, 0.0, METERING_DIVISOR)
        return key_light(self.renderer, self.look, self.config.light.key, capture.scene, camera)

    @cached_property
    def lens(self) -> Lens:
        """Lens of all cameras."""
        realism = self.config.realism
        return Lens(LENS_BLUR if "lens-blur" in realism else 0.0, "vignetting" in realism)

    def render(self, capture: Capture, offset: float, divisor: int, outputs: Output) -> Frame:
        """Render the view ``offset`` metres to the right of the left camera, at 1/``divisor`` of its resolution."""
        look = self.lit(self.look, capture)
        return self.renderer.render(capture.scene, self.camera(capture, offset, divisor), outputs, look)

    def render_lit(
        self, capture: Capture, offset: float, divisor: int, outputs: Output, key: KeyLight | None = None
    ) -> Frame:
        """Render the surfaces that a matcher measures and that dots fall on; the arguments are those of ``render``.

        Depth and instances ignore surfaces that are mostly transparent.
        """
        look = self.lit(self._solid_look, capture, key)
        return self.renderer.render(capture.scene, self.camera(capture, offset, divisor), outputs, look)

    def camera(self, capture: Capture, offset: float, divisor: int) -> Camera:
        """Return the camera of ``render`` with the same arguments."""
        config = self.config
        return config.model.camera(
            capture.X_world_left, offset=offset, divisor=divisor, near=config.near, far=config.far
        )

    def meter(self, capture: Capture, settings: StreamSettings) -> MeteredExposure:
        """Return exposure and mean brightness of the left image; the manual exposure for an undecodable texture."""
        # Metering may need the light of the camera's own projector while it is off.
        lit_capture = replace(capture, gpio=capture.gpio | 1) if settings.meters_lit_images else capture
        try:
            key = self.key_light(capture)
            frame, dots = self._render_with_dots(lit_capture, 0.0, METERING_DIVISOR, key)
        except ImageError:
            return MeteredExposure(settings.manual_exposure, 0.0)
        rendered, manual = frame.roots, settings.manual_exposure
        assert rendered is not None
        other_dots = None
        if capture.projectors:
            other_dots = light_of_projectors(
                self.renderer,
                self.lit(self._solid_look, capture),
                self.config,
                capture,
                frame,
                0.0,
                METERING_DIVISOR,
                has_own=False,
            )
        scene_light = self.scene_light(frame, other_dots)
        k, lens = self.config.model.intrinsics(METERING_DIVISOR), Lens(vignetting=self.lens.vignetting)

        def light(scene_light: SceneLight) -> NDArray[np.float32]:
            return relative_light(light_on_sensor(rendered, k, manual, scene_light, lens, color=False)[:, :, 0])

        unlit = lit = light(scene_light)
        if dots is not None:
            lit = light(replace(scene_light, dots=dots))
        exposure, out1_reduction = choose_exposure(
            unlit, lit, out1_high=capture.out1_high, settings=settings, memory=self.exposure_memory
        )
        brightness = exposure.response((lit if capture.out1_high else unlit) * exposure.light).mean()
        return MeteredExposure(exposure, float(brightness), out1_reduction, key)

    def expose(self, capture: Capture, request: ImageRequest) -> dict[bool, SensorImage]:
        """Return the requested images of one camera at full resolution, by ``COLOR`` or ``GREY``."""
        config, exposure = self.config, request.exposure
        right = request.stream.is_right
        offset = config.model.baseline if right else 0.0
        key = frame_key(config.seed, capture.frame_number, request.stream)
        k = config.model.intrinsics()
        pattern = None
        if config.has_fixed_pattern:
            pattern = fixed_pattern(config.seed, right=right, height=k.height, width=k.width)
        noise_factor = config.noise_factor / request.averaged_images**0.5
        key_light = request.key_light or self.key_light(capture)
        frame, dots = self._render_with_dots(capture, offset, 1, key_light)
        assert frame.roots is not None
        if "motion-blur" in config.realism:
            self._blur_motion(capture, offset, exposure.time, frame.roots)
        scene_light = self.scene_light(frame, dots)
        return {
            color: image_from_light(
                light_on_sensor(frame.roots, k, exposure, scene_light, self.lens, color=color),
                exposure,
                key,
                pattern,
                noise_factor,
            )
            for color in request.colors
        }

    def measure(
        self, capture: Capture, settings: StreamSettings, pair: ImagePair | None, dark_pair: ImagePair | None = None
    ) -> DepthImages:
        """Return the depth images of a capture, by matching ``pair``, images of the same exposure; None: from exact
        depth.

        ``dark_pair`` is as in ``matched_depth``.
        """
        config = self.config
        if pair is not None:
            return matched_depth(config, pair, settings, dark_pair, self.renderer.parallel)
        divisor = settings.quality.divisor
        left = self.render(capture, 0.0, divisor, Output.DEPTH).depth
        right = self.render(capture, config.model.baseline, divisor, Output.DEPTH).depth
        assert left is not None
        assert right is not None
        return exact_depth(config.model, left, right, settings)

    def scene_light(self, frame: Frame, dots: NDArray[np.uint16] | None) -> SceneLight:
        """Return the light besides the rendered one; ``dots``, (H, W) uint16, is that of projectors, None: all off."""
        return SceneLight(dots, self.config.full_dot_light, frame.key_factor)

    def _blur_motion(self, capture: Capture, offset: float, exposure_time: float, roots: NDArray[np.uint32]) -> None:
        """Blur the parts of a rendered image in which something has moved since ``capture.earlier``."""
        earlier = capture.earlier
        if earlier is None:
            return
        camera = self.camera(capture, offset, 1)
        X_world_before = self.camera(replace(capture, X_world_left=earlier.X_world_left), offset, 1).X_world_camera
        motion = motion_since(earlier, capture.timestamp, capture.scene, X_world_before, camera.X_world_camera)
        if motion is not None:
            blur_motion(self.renderer, self.lit(self.look, capture), motion, camera, exposure_time, roots)

    def _render_with_dots(
        self, capture: Capture, offset: float, divisor: int, key: KeyLight | None
    ) -> tuple[Frame, NDArray[np.uint16] | None]:
        """Return the rendered colour image, and the light of the projectors on it; see ``light_of_projectors``."""
        outputs = Output.ROOTS | Output.KEY_FACTOR if key is not None else Output.ROOTS
        has_own = capture.has_projection(self.config)
        if capture.projectors:
            outputs |= Output.DEPTH | Output.INSTANCE | Output.NORMAL | Output.LIGHT
        if has_own:
            outputs |= Output.DEPTH | Output.INSTANCE | Output.LAMP_SHARE
        frame = self.render_lit(capture, offset, divisor, outputs, key)
        if not (has_own or capture.projectors):
            return frame, None
        return frame, light_of_projectors(
            self.renderer,
            self.lit(self._solid_look, capture),
            self.config,
            capture,
            frame,
            offset,
            divisor,
            has_own=has_own,
        )


def choose_exposure(
    unlit: NDArray[np.float32],
    lit: NDArray[np.float32],
    *,
    out1_high: bool,
    settings: StreamSettings,
    memory: ExposureMemory,
) -> tuple[Exposure, float]:
    """Return the exposure of an image and ``out1_reduction``. Unlike the device's, it does not take frames to adapt.

    * ``Normal``: every image is metered by itself. In alternate exposure, the image with Out1 high determines both
      exposures.
    * ``Out1High``: only images with Out1 high are metered. Images with Out1 low get the exposure of the last one
      metered.
    * ``AdaptiveOut1``: images with Out1 low are exposed less, so that nothing is over-exposed when Out1 goes high.

    In the last two, ``out1_reduction`` is the share by which images with Out1 low are exposed less, 0 to 1.

    Args:
        unlit: (h, w) float32, light of the left image at 1/``METERING_DIVISOR`` of the resolution, 1 is white, without
            the projector's light.
        lit: (h, w) float32, the same with the projector's light.
        out1_high: True if Out1 is high in this image.
        settings: parameters of the frame.
        memory: state between frames; updated.
    """
    limits, manual = settings.auto_exposure, settings.manual_exposure
    if limits is None:
        return manual, 0.0
    unlit, lit = _metered_region(unlit, settings), _metered_region(lit, settings)
    if settings.auto_exposure_mode == "Normal":
        return auto_exposure(lit if out1_high or settings.alternate_exposure else unlit, limits, manual), 0.0
    exposure = memory.out1_high
    if exposure is None or out1_high or settings.auto_exposure_mode == "AdaptiveOut1":
        exposure = auto_exposure(lit, limits, manual)
    if settings.auto_exposure_mode == "Out1High":
        memory.out1_high = exposure
    return exposure, min(max(1.0 - exposure.light / auto_exposure(unlit, limits, manual).light, 0.0), 1.0)


def _metered_region(values: NDArray[np.float32], settings: StreamSettings) -> NDArray[np.float32]:
    """Return the pixels of the exposure region, or the whole image if the region lies outside."""
    region = settings.exposure_region
    if region is None:
        return values
    inside = values[region.slices(METERING_DIVISOR)]
    return inside if inside.size else values


def exact_depth(
    model: StereoModel, left_depth: NDArray[np.float32], right_depth: NDArray[np.float32], settings: StreamSettings
) -> DepthImages:
    """Return depth images from rendered depth of the left and the right camera, (H, W) float32, metres.

    It has the depth images' resolution. All holes and segments are true, so ``double_shot``, ``minconf``, ``seg`` and
    ``fill`` have no effect.
    """
    divisor, filters = settings.quality.divisor, replace(settings.filters, minconf=0.0, seg=0, fill=0)
    focal_times_baseline = model.focal_times_baseline(divisor)
    disparity = true_disparity(
        left_depth, right_depth, focal_times_baseline, settings.filters.measurable_depths(model, divisor)
    )
    if settings.depth_region is not None:
        settings.depth_region.clear_outside(disparity, divisor)
    images = exact_images(disparity)
    apply_filters(images, filters, focal_times_baseline, divisor)
    return images
