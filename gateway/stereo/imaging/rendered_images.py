"""Make the images, depth and meshes of a frame, in worker threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.depth.matched_depth import matched_depth
from gateway.stereo.depth.rendered_depth import ImagePair, ground_truth_depth, modelled_depth
from gateway.stereo.device.camera_config import StereoConfig
from gateway.stereo.device.stream_settings import StreamSettings
from gateway.stereo.imaging.auto_exposure import METERING_DIVISOR, ExposureMemory, choose_exposure
from gateway.stereo.imaging.extra_renderings import blur_motion, key_light_factors
from gateway.stereo.imaging.other_projector import OtherProjector
from gateway.stereo.imaging.scene_motion import SceneState, motion_since
from renderers.camera import Camera
from renderers.drawlist import DrawList, ImageError
from renderers.interface import Frame, Look, Output, Renderer
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.pixel_classes import ImageKind
from renderers.stereo.lens.optics import LENS_BLUR, Lens, SceneLight, light_on_sensor, relative_light
from renderers.stereo.light.posed_projector import Surfaces, add_dots
from renderers.stereo.light.projector import projected_dots, returned_shares
from renderers.stereo.mesh.disparity_mesh import MeshOptions, disparity_mesh
from renderers.stereo.sensor.exposure import Exposure, SensorImage, image_from_light
from renderers.stereo.sensor.fixed_pattern import fixed_pattern
from renderers.stereo.sensor.noise import NoiseStream, frame_key


@dataclass(frozen=True, eq=False)
class Capture:
    """Scene, camera pose and digital outputs at one instant."""

    timestamp: int
    """Nanoseconds since the epoch."""
    scene: DrawList
    revision: int
    """Revision of the scene."""
    X_world_left: NDArray[np.float64]
    """(4, 4) float64, pose of the left optical frame in the world."""
    gpio: int
    """Values of the digital inputs and outputs, one bit each; Out1 is bit 0."""
    frame_number: int = 0
    earlier: SceneState | None = None
    """Frame before this one, for motion blur and rolling shutters; None: there is none, or nothing needs it."""
    projectors: tuple[OtherProjector, ...] = ()
    """Projectors of other cameras that are on."""

    @classmethod
    def of_state(
        cls,
        state: SceneState,
        settings: StreamSettings,
        timestamp: int,
        frame_number: int,
        earlier: SceneState | None = None,
        *,
        depth: bool,
    ) -> Capture:
        """Return a capture of a state of the scene.

        All cameras expose at the same time and for the same purpose, as with a common trigger: so their parameters tell
        which projectors are on.

        Args:
            timestamp: time that clients get, nanoseconds since the epoch.
            depth: True: exposure for depth; False: exposure for camera images.
        """
        gpio = settings.depth_gpio if depth else settings.camera_gpio
        projectors = tuple(
            each for each in state.projectors if (each.settings.depth_gpio if depth else each.settings.camera_gpio) & 1
        )
        return cls(timestamp, state.scene, state.revision, state.X_world_left, gpio, frame_number, earlier, projectors)

    @cached_property
    def out1_high(self) -> bool:
        """True if Out1 is high."""
        return bool(self.gpio & 1)

    def has_projection(self, config: StereoConfig) -> bool:
        """Return True if there is a projector and it is on. It is connected to Out1."""
        return config.projector and config.dot_light > 0.0 and self.out1_high


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


@dataclass(frozen=True, slots=True)
class MeteredExposure:
    """Result of automatic exposure."""

    exposure: Exposure
    brightness: float
    """Mean of the exposed image, 0 to 1."""
    out1_reduction: float = 0.0
    """See ``auto_exposure``."""


@dataclass(frozen=True, slots=True, eq=False)
class ColorImage:
    """Image of a colour camera."""

    sensor_image: SensorImage
    exposure: Exposure


@dataclass(frozen=True, eq=False)
class Imaging:
    """Source of images and depth: the rendered scene, with the effects of ``config.realism``.

    Rendered depth does not depend on these effects.
    """

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
    def _lit_look(self) -> Look:
        """Look of ``render_lit``."""
        return replace(self.look, alpha_threshold=max(self.look.alpha_threshold, DOT_ALPHA))

    @cached_property
    def lens(self) -> Lens:
        """Lens of all cameras."""
        realism = self.config.realism
        return Lens(LENS_BLUR if "lens-blur" in realism else 0.0, "vignetting" in realism)

    @cached_property
    def _dot_light(self) -> float:
        """Light that a full dot adds, relative to the rendered light; 1 if the camera's own dots add none."""
        return self.config.dot_light or 1.0

    def render(self, capture: Capture, offset: float, divisor: int, outputs: Output) -> Frame:
        """Render the view from ``offset`` metres to the right of the left camera.

        Args:
            capture: scene and pose.
            offset: metres along the left camera's x axis.
            divisor: width of the camera images divided by that of the rendered images.
            outputs: images to render.
        """
        return self.renderer.render(capture.scene, self.camera(capture, offset, divisor), outputs, self.look)

    def render_lit(self, capture: Capture, offset: float, divisor: int, outputs: Output) -> Frame:
        """Render the surfaces that a matcher measures and that dots fall on; the arguments are those of ``render``.

        Depth and instances ignore surfaces that are mostly transparent.
        """
        return self.renderer.render(capture.scene, self.camera(capture, offset, divisor), outputs, self._lit_look)

    def camera(self, capture: Capture, offset: float, divisor: int) -> Camera:
        """Return the camera of ``render`` with the same arguments."""
        config = self.config
        return config.model.camera(
            capture.X_world_left, offset=offset, divisor=divisor, near=config.near, far=config.far
        )

    def meter(self, capture: Capture, settings: StreamSettings) -> MeteredExposure:
        """Return the exposure of a capture's images, and the mean brightness of the left image.

        The exposure is the manual one if a texture cannot be decoded.
        """
        # Metering may need the light of the camera's own projector while it is off.
        lit_capture = replace(capture, gpio=capture.gpio | 1) if settings.meters_lit_images else capture
        try:
            frame, dots = self._render_with_dots(lit_capture, 0.0, METERING_DIVISOR)
        except ImageError:
            return MeteredExposure(settings.manual_exposure, 0.0)
        rendered, manual = frame.color, settings.manual_exposure
        assert rendered is not None
        other_dots = None
        if capture.projectors:
            other_dots = self._projected_dots(frame, capture, 0.0, METERING_DIVISOR, has_own=False)
        half = partial(self.camera, capture, 0.0, 2 * METERING_DIVISOR)
        scene_light = self.scene_light(capture.scene, half, other_dots)
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
        return MeteredExposure(exposure, float(brightness), out1_reduction)

    def expose(self, capture: Capture, request: ImageRequest) -> dict[bool, SensorImage]:
        """Return the requested images of one camera at full resolution, by ``COLOR`` or ``GREY``."""
        config, exposure = self.config, request.exposure
        right = request.stream.is_right
        offset = config.model.baseline if right else 0.0
        key = frame_key(config.seed, capture.frame_number, request.stream)
        k = config.model.intrinsics()
        pattern = None
        if "fixed-pattern" in config.realism and config.noise_factor > 0.0:
            pattern = fixed_pattern(config.seed, right=right, height=k.height, width=k.width)
        noise_factor = config.noise_factor / request.averaged_images**0.5
        frame, dots = self._render_with_dots(capture, offset, 1)
        assert frame.color is not None
        if "motion-blur" in config.realism:
            self._blur_motion(capture, offset, exposure.time, frame.color)
        scene_light = self.scene_light(capture.scene, partial(self.camera, capture, offset, 2), dots)
        return {
            color: image_from_light(
                light_on_sensor(frame.color, k, exposure, scene_light, self.lens, color=color),
                exposure,
                key,
                pattern,
                noise_factor,
            )
            for color in request.colors
        }

    def image_kind(self, capture: Capture) -> ImageKind:
        """Return the kind of a capture's images."""
        dots = capture.has_projection(self.config) or bool(capture.projectors)
        return ImageKind.of(dots=dots, realistic=bool(self.config.realism))

    def measure(
        self, capture: Capture, settings: StreamSettings, pair: ImagePair | None, dark_pair: ImagePair | None = None
    ) -> DepthImages:
        """Return the depth images of a capture, by matching or from rendered depth.

        Args:
            capture: scene and pose.
            settings: parameters of the frame.
            pair: images of the same exposure, to match or for modelled errors; None: no errors.
            dark_pair: see ``matched_depth``.
        """
        config = self.config
        divisor = settings.quality.divisor
        if pair is not None and config.depth_mode == "matched":
            return matched_depth(config, pair, settings, dark_pair)
        render = self.render_lit if config.models_errors else self.render
        left = render(capture, 0.0, divisor, Output.DEPTH).depth
        right = render(capture, config.model.baseline, divisor, Output.DEPTH).depth
        assert left is not None
        assert right is not None
        if pair is None:
            return ground_truth_depth(config, left, right, settings)
        return modelled_depth(config, left, right, pair, settings)

    def mesh(
        self, images: DepthImages, divisor: int, options: MeshOptions, left: NDArray[np.uint8] | None
    ) -> tuple[bytes, memoryview, memoryview]:
        """Return a mesh as the parts of a PLY file.

        Args:
            images: depth images.
            divisor: width of the camera images divided by that of the depth images.
            options: mesh options of the request.
            left: left image, for a textured mesh.
        """
        model = self.config.model
        return disparity_mesh(images.disparity, model.intrinsics(divisor), model.baseline, options, left)

    def scene_light(self, scene: DrawList, half: Callable[[], Camera], dots: NDArray[np.uint16] | None) -> SceneLight:
        """Return the light on the scene besides the rendered one.

        Args:
            scene: scene of the image.
            half: returns the camera with half the resolution of the image.
            dots: (H, W) uint16, light of projectors; None: all are off.
        """
        factors = None
        if "shadows" in self.config.realism:
            factors = key_light_factors(self.renderer, self.look, scene, half())
        return SceneLight(dots, self._dot_light, factors, self.config.background)

    def _blur_motion(self, capture: Capture, offset: float, exposure_time: float, color: NDArray[np.uint8]) -> None:
        """Blur the parts of a rendered image in which something has moved since ``capture.earlier``.

        Args:
            capture: scene and pose of this frame and of the frame before.
            offset: metres along the left camera's x axis.
            exposure_time: seconds.
            color: (H, W, 3) uint8, rendered image, changed.
        """
        earlier = capture.earlier
        if earlier is None:
            return
        camera = self.camera(capture, offset, 1)
        X_world_before = self.camera(replace(capture, X_world_left=earlier.X_world_left), offset, 1).X_world_camera
        motion = motion_since(earlier, capture.timestamp, capture.scene, X_world_before, camera.X_world_camera)
        if motion is not None:
            blur_motion(self.renderer, self.look, motion, camera, exposure_time, color)

    def _render_with_dots(
        self, capture: Capture, offset: float, divisor: int
    ) -> tuple[Frame, NDArray[np.uint16] | None]:
        """Return the rendered colour image, and the light of the projectors on it; see ``_projected_dots``."""
        outputs = Output.COLOR
        has_own = capture.has_projection(self.config)
        if capture.projectors:
            outputs |= Output.DEPTH | Output.INSTANCE | Output.NORMAL
        if has_own:
            outputs |= Output.DEPTH | Output.INSTANCE
        frame = self.render_lit(capture, offset, divisor, outputs)
        if outputs == Output.COLOR:
            return frame, None
        return frame, self._projected_dots(frame, capture, offset, divisor, has_own=has_own)

    def _projected_dots(
        self, frame: Frame, capture: Capture, offset: float, divisor: int, *, has_own: bool
    ) -> NDArray[np.uint16]:
        """Return the light of the projectors at each pixel of a frame, (H, W) uint16.

        The other arguments are those with which the frame was rendered.

        Args:
            has_own: True if the camera's own projector is on.
        """
        assert frame.depth is not None
        assert frame.instance is not None
        returned = frame.instance, returned_shares(capture.scene.instances)
        model = self.config.model
        soft = "projector" in self.config.realism
        k = model.intrinsics(divisor)
        projector_offset = model.baseline / 2
        right = offset > projector_offset
        dots = np.zeros(frame.depth.shape, np.uint16)
        if has_own:
            projector_view = self.render_lit(capture, projector_offset, divisor, Output.DEPTH)
            assert projector_view.depth is not None
            dots = projected_dots(
                frame.depth,
                k.focal_length,
                k.cx,
                k.cy,
                offset - projector_offset,
                projector_view.depth,
                soft=soft,
                right=right,
                point_samples=soft and divisor == METERING_DIVISOR,
                returned=returned,
            )
        for other in capture.projectors:
            assert frame.normal is not None
            surfaces = Surfaces(self.camera(capture, offset, divisor), frame.depth, frame.normal, returned)
            projector = other.camera(divisor, near=self.config.near, far=self.config.far)
            projector_view = self.renderer.render(capture.scene, projector, Output.DEPTH, self._lit_look)
            assert projector_view.depth is not None
            strength = other.dot_light / self._dot_light
            add_dots(dots, surfaces, projector, projector_view.depth, strength, soft=soft, right=right)
        return dots
