"""Camera profiles: TOML files that describe a camera model. ``docs/camera-profiles.md`` explains their keys.

``read_profile`` reads a shipped file from ``profiles/``, or a user's file.
"""

import math
import tomllib
from functools import cache
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec

from gateway.adapters.stereo.device.parameter_specs import DeviceLimits
from renderers.stereo.lens.color_camera import ColorCamera
from renderers.stereo.model import MAX_DISPARITIES, Intrinsics, Quality, StereoModel
from scenegate.regular_files import read_regular

DEFAULT_PROFILE: Final = "rc_visard_160c"
MAX_FILE_BYTES: Final = 16 << 10
"""Maximum size of a profile: the shipped ones have less than 1 kB, and parsing nested keys takes cubic time."""
MAX_PIXELS: Final = 1 << 24
"""Maximum number of pixels of an image: 4096 x 4096. Rendering and matching one of that size takes seconds and 1 GB."""
MIN_FOCAL_FACTOR: Final = 0.05
"""Minimum focal length in widths of the image: a field of view of 169 degrees."""
MAX_FOCAL_FACTOR: Final = 20.0
"""Maximum focal length in widths of the image: a field of view of 3 degrees."""
MIN_ROTATION_NORM: Final = 1e-3
"""Minimum length of the quaternion ``color.rotation``. Rounding errors rotate the camera if it is shorter."""
_FOLDER: Final = Path(__file__).parent / "profiles"
PROFILE_NAMES: Final = tuple(sorted(path.stem for path in _FOLDER.glob("*.toml")))
"""Names of the shipped profiles."""


ImageSide = Annotated[int, msgspec.Meta(ge=16, le=8192)]
"""Width or height of an image, pixels."""
DepthMode = Literal["matched", "ground_truth"]
Pixels = Annotated[float, msgspec.Meta(ge=-100_000, le=100_000)]
FocalLength = Annotated[float, msgspec.Meta(gt=0, le=100_000)]
"""Pixels."""
Metres = Annotated[float, msgspec.Meta(ge=-100, le=100)]
Depth = Annotated[float, msgspec.Meta(ge=0.01, le=100)]
"""Metres along the optical axis."""
Rate = Annotated[float, msgspec.Meta(ge=1, le=1000)]
"""Images per second."""
MinusOneToOne = Annotated[float, msgspec.Meta(ge=-1, le=1)]


class ProfileError(ValueError):
    """A profile cannot be used. The message is one sentence that names the file and the key."""


class StereoSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The two stereo cameras, with a global shutter. Images are rectified."""

    size: tuple[ImageSide, ImageSide]
    """Width and height of the images, pixels."""
    focal_length: FocalLength
    """Focal length of rectified images, pixels."""
    baseline: Annotated[float, msgspec.Meta(ge=1e-4, le=100)]
    """Distance between the cameras, metres. The right camera is at +x of the left one."""
    principal_point: tuple[Pixels, Pixels] | None = None
    """Principal point, pixels from the left and the upper edge; None: the centre of the image."""
    color: bool = True
    """True if left and right images can have colour."""
    noise: Annotated[float, msgspec.Meta(ge=0, le=100)] = 1.0
    """Factor of the image noise; 1 is the rc_visard's."""
    fps: Rate = 25.0
    """Maximum frame rate, Hz."""


class DepthSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Depth images."""

    range: tuple[Depth, Depth] = (0.1, 100.0)
    """Nearest and farthest depth, metres: the limits of the parameters ``mindepth`` and ``maxdepth``."""
    mode: DepthMode = "matched"
    """Source of depth: a matcher, as in the rc_visard, or exact depth, as in simulators' RGB-D cameras."""
    max_disparities: Annotated[int, msgspec.Meta(ge=16, le=MAX_DISPARITIES)] = MAX_DISPARITIES
    """Number of disparities that are searched at quality ``Full``, which limits the nearest depth."""
    quality: Quality = Quality.HIGH
    """Default of the parameter ``quality``."""
    rates: dict[Quality, Rate] = {}
    """Rate of depth images by quality, Hz. A missing quality has the rc_visard's rate."""


class ProjectorSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Random-dot projector half-way between the stereo cameras."""

    output: Literal["Low", "High", "ExposureActive", "ExposureAlternateActive"] = "Low"
    """Default of the parameter ``out1_mode``. Output 1 switches the projector on and off."""
    light: Annotated[float, msgspec.Meta(ge=0, le=100)] = 2.0
    """Light that a full dot adds, relative to the rendered light."""


class ColorSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Separate colour camera. It does not see the projector's light."""

    size: tuple[ImageSide, ImageSide]
    """Width and height of the images, pixels."""
    focal_length: FocalLength
    """Focal length, pixels."""
    principal_point: tuple[Pixels, Pixels] | None = None
    """Principal point, pixels from the left and the upper edge; None: the centre of the image."""
    position: tuple[Metres, Metres, Metres] = (0.0, 0.0, 0.0)
    """Optical centre in the left optical frame, metres."""
    rotation: tuple[MinusOneToOne, MinusOneToOne, MinusOneToOne, MinusOneToOne] = (1.0, 0.0, 0.0, 0.0)
    """Orientation in the left optical frame: quaternion [w, x, y, z], not necessarily of length 1."""
    noise: Annotated[float, msgspec.Meta(ge=0, le=100)] = 1.0
    """Factor of the image noise; 1 is the rc_visard's."""
    readout: Annotated[float, msgspec.Meta(ge=0, le=0.1)] = 0.0
    """Time between the exposures of the first and the last row (rolling shutter), seconds; 0: global shutter."""


class Profile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A camera model: the content of a profile file."""

    name: Annotated[str, msgspec.Meta(min_length=1, max_length=80)]
    """Model name in the device's system information."""
    stereo: StereoSection
    depth: DepthSection = DepthSection()
    projector: ProjectorSection | None = None
    """None: the camera has no projector."""
    color: ColorSection | None = None
    """None: colour images come from the left camera."""

    @property
    def model(self) -> StereoModel:
        """Geometry of the stereo cameras."""
        (width, height), stereo = self.stereo.size, self.stereo
        return StereoModel(
            self.name,
            width,
            height,
            stereo.focal_length / width,
            stereo.baseline,
            self.depth.max_disparities,
            stereo.principal_point,
        )

    @property
    def color_camera(self) -> ColorCamera | None:
        """The separate colour camera; None if there is none."""
        color = self.color
        if color is None:
            return None
        width, height = color.size
        cx, cy = color.principal_point or (width / 2, height / 2)
        intrinsics = Intrinsics(width, height, color.focal_length, cx, cy)
        return ColorCamera(intrinsics, color.position, color.rotation, color.noise, color.readout)

    @property
    def limits(self) -> DeviceLimits:
        """Limits and defaults of the device's parameters."""
        rates = {quality: self.depth.rates.get(quality, quality.depth_rate) for quality in Quality}
        out1_mode = self.projector.output if self.projector is not None else "Low"
        return DeviceLimits(self.stereo.fps, self.depth.range, self.depth.quality, out1_mode, rates)


def read_profile(name: str) -> Profile:
    """Return a shipped profile by its name, or that of a TOML file. Raises ProfileError if there is none, or it is
    invalid."""
    if name in PROFILE_NAMES:
        return _shipped_profile(name)
    path = Path(name)
    if path.suffix != ".toml":
        raise ProfileError(f"there is no camera profile {name!r}: use {', '.join(PROFILE_NAMES)} or a .toml file")
    return _read_file(path)


@cache
def _shipped_profile(name: str) -> Profile:
    return _read_file(_FOLDER / f"{name}.toml")


def _read_file(path: Path) -> Profile:
    try:
        data = read_regular(path, MAX_FILE_BYTES)
    except OSError as error:
        raise ProfileError(f"camera profile {path}: {error.strerror}") from None
    try:
        profile = msgspec.convert(tomllib.loads(data.decode()), Profile)
        _check(profile)
    except (ValueError, RecursionError) as error:  # ValueError: TOMLDecodeError, UnicodeDecodeError, ValidationError
        raise ProfileError(f"camera profile {path}: {str(error).replace('$.', '')}") from None
    return profile


def _check(profile: Profile) -> None:
    """Check limits that the annotations do not state, and keys that depend on each other. Raises ValueError."""
    for name, section in (("stereo", profile.stereo), ("color", profile.color)):
        if section is not None:
            _check_intrinsics(name, section.size, section.focal_length)
    nearest, farthest = profile.depth.range
    if nearest >= farthest:
        raise ValueError(f"depth.range: {nearest:g} is not less than {farthest:g}")
    norm = math.hypot(*profile.color.rotation) if profile.color is not None else 1.0
    if norm < MIN_ROTATION_NORM:
        raise ValueError(f"color.rotation has the length {norm:g}, the minimum is {MIN_ROTATION_NORM:g}")
    if profile.model.nearest_depth(nearest, farthest, 1) >= farthest:
        raise ValueError(f"depth.range: nothing nearer than {farthest:g} m can be measured with this baseline")


def _check_intrinsics(section: str, size: tuple[int, int], focal_length: float) -> None:
    """Check the number of pixels and the field of view of a camera. Raises ValueError, which names the section.

    Width, height and focal length are in pixels.
    """
    width, height = size
    if width * height > MAX_PIXELS:
        raise ValueError(f"{section}.size: {width}x{height} has {width * height} pixels, the limit is {MAX_PIXELS}")
    least, most = MIN_FOCAL_FACTOR * width, MAX_FOCAL_FACTOR * width
    if not least <= focal_length <= most:
        raise ValueError(
            f"{section}.focal_length is {focal_length:g}, images {width} pixels wide need {least:g} to {most:g}"
        )
