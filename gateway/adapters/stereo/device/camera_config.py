"""Configuration of a stereo camera, fixed at start."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.parameter_specs import DeviceLimits
from gateway.adapters.stereo.device.profile import DEFAULT_PROFILE, DepthMode, Profile, read_profile
from gateway.runtime.http.tokens import Tokens
from renderers.interface import LookName
from renderers.light_rig import Rig
from renderers.stereo.lens.color_camera import ColorCamera
from renderers.stereo.light.levels import LightLevels
from renderers.stereo.model import Intrinsics, StereoModel
from renderers.stereo.realism import RealismPart

Rate = Literal["device", "max"]
METERING_DIVISOR: Final = 8
"""Width of the camera images divided by that of the image that automatic exposure meters."""


@dataclass(frozen=True, slots=True)
class Tls:
    """TLS files in PEM format."""

    certificate: Path
    """Certificate of the server."""
    key: Path
    """Private key of the server."""
    client_ca: Path | None = None
    """Certificate of the authority that must have signed clients' certificates; None: clients need no certificate."""


@dataclass(frozen=True)
class StereoConfig:
    """Configuration of one stereo camera. Defaults are the device's where it has them."""

    name: str = "stereo"
    """Name of the camera in ``/cameras``."""
    host: str = "127.0.0.1"
    """Address to listen on."""
    port: int = 50051
    """Port of the image stream; 0: any free port."""
    tls: Tls | None = None
    """TLS of the image stream; None: plaintext, as on the device."""
    tokens: Tokens | None = None
    """Bearer tokens of the image stream; None: no token is needed, as on the device."""
    model: StereoModel = field(default_factory=lambda: read_profile(DEFAULT_PROFILE).model)
    """Geometry of the camera."""
    limits: DeviceLimits = field(default_factory=DeviceLimits)
    """Limits and defaults of the device's parameters."""
    color: bool = True
    """True if the left and right images can have colour."""
    color_camera: ColorCamera | None = None
    """Separate colour camera; None: colour images come from the left camera."""
    depth_mode: DepthMode = "matched"
    """Source of depth images: matched camera images, or exact rendered depth."""
    rate: Rate = "device"
    """``device``: the real camera's rates; ``max``: as fast as rendering and clients allow."""
    simulated_clock: bool = False
    """True: timestamps count frames instead of time, and no frame is skipped for lack of time."""
    seed: int = 0
    """Seed of all noise. Seed, scene and frame number determine every byte except timestamps."""
    noise: bool = True
    """True: camera images have noise."""
    image_noise: float = 1.0
    """Factor of the standard deviation of the image noise."""
    realism: frozenset[RealismPart] = frozenset()
    """Effects of real lenses and lights that camera images have."""
    light: LightLevels = field(default_factory=LightLevels)
    """Light of each source in camera images."""
    rig: Rig = field(default_factory=Rig)
    """Rig whose lights a scene without lights has; only its lights and ``scene_lights`` count."""
    look: LookName = "gltf"
    """Shading of the rendered images."""
    background: tuple[int, int, int] = (204, 229, 255)
    """RGB of the background."""
    alpha_threshold: float = 0.0
    """Alpha below which blended surfaces are left out of depth; see ``Look.alpha_threshold``."""
    near: float = 0.01
    """Near clipping plane of the rendered images, metres."""
    far: float = 10_000.0
    """Far clipping plane, metres; depth images have their own limits (mindepth, maxdepth)."""
    projector: bool = True
    """True if the camera has a random-dot projector, on output Out1."""
    dot_light: float = 2.0
    """Light of the centre of a dot on a surface that faces the projector 1.5 m away, in the unit of ``light``."""
    serial: str = "02900000"
    """Serial number in the system information."""
    hostname: str = "scenegate"
    """Host name in the system information."""
    max_clients: int = 64
    """Maximum number of streams. Each stream holds one set (up to 70 MB with a full mesh) in its mailbox, and unsent
    bytes in its socket."""
    max_pairs: int = 10_000
    """Maximum number of recorded stereo pairs in a folder: 400 s at the camera's rate."""
    max_pair_pixels: int = 20_000_000
    """Maximum number of pixels of a recorded image: 16 times the device's. Such an image takes 60 MB when decoded, and
    eight are cached."""
    faults: bool = False
    """True if fault injection over REST is permitted."""
    max_late_bytes: int = 256 << 20
    """Maximum number of bytes of sets that an injected delay holds back: 10 s of 1280x960 camera images at 10 Hz."""
    max_events: int = 64
    """Maximum number of image events in a client's queue: 2.5 s at the highest rate, about 2 kB."""
    max_kinds: int = 16
    """Maximum number of different requests: each is serialised separately, and meshes take up to 0.1 s each."""
    history: int = 100
    """Number of frames for ``/stereo/truth.npz``: 4 s at the camera's rate. A frame is rendered again on request, from
    its draw list, which shares meshes with other frames."""
    frames_in_flight: int = 2
    """Maximum number of frames in flight: one is rendered while the other is filtered and serialised."""

    @classmethod
    def of_profile(cls, profile: Profile) -> StereoConfig:
        """Return the configuration of a camera model; other fields have their defaults."""
        projector = profile.projector
        return cls(
            model=profile.model,
            limits=profile.limits,
            color=profile.stereo.color,
            color_camera=profile.color_camera,
            image_noise=profile.stereo.noise,
            depth_mode=profile.depth.mode,
            projector=projector is not None,
            dot_light=projector.light if projector is not None else 0.0,
        )

    @cached_property
    def noise_factor(self) -> float:
        """``image_noise``, or 0 if noise is disabled."""
        return self.image_noise if self.noise else 0.0

    @cached_property
    def has_fixed_pattern(self) -> bool:
        """True if the sensors have a fixed pattern."""
        return "fixed-pattern" in self.realism and self.noise_factor > 0.0

    @cached_property
    def full_dot_light(self) -> float:
        """Unit of the light of all projectors: ``dot_light``, or 1 if the camera's own dots add none."""
        return self.dot_light or 1.0

    @cached_property
    def color_intrinsics(self) -> Intrinsics:
        """Intrinsics of colour images: those of the colour camera or, without one, of the left camera."""
        return self.model.intrinsics() if self.color_camera is None else self.color_camera.intrinsics

    @cached_property
    def X_left_color(self) -> NDArray[np.float64]:
        """Pose of the camera of colour images in the left optical frame, (4, 4) float64."""
        return np.eye(4) if self.color_camera is None else self.color_camera.X_left_color

    @cached_property
    def uses_motion(self) -> bool:
        """True if images depend on the previous frame: with a rolling shutter, or motion blur."""
        rolling = self.color_camera is not None and self.color_camera.readout > 0.0
        return rolling or "motion-blur" in self.realism
