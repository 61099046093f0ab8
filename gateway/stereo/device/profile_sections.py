"""Tables of a camera profile file: stereo cameras, depth, projector, colour camera."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from renderers.stereo.model import MAX_DISPARITIES, Quality

ImageSide = Annotated[int, msgspec.Meta(ge=16, le=8192)]
"""Width or height of an image, pixels."""
Pixels = Annotated[float, msgspec.Meta(ge=-100_000, le=100_000)]
FocalLength = Annotated[float, msgspec.Meta(gt=0, le=100_000)]
"""Pixels."""
Metres = Annotated[float, msgspec.Meta(ge=-100, le=100)]
Depth = Annotated[float, msgspec.Meta(ge=0.01, le=100)]
"""Metres along the optical axis."""
Rate = Annotated[float, msgspec.Meta(ge=1, le=1000)]
"""Images per second."""
Coefficient = Annotated[float, msgspec.Meta(ge=-100, le=100)]
"""Coefficient of a lens's distortion."""
MinusOneToOne = Annotated[float, msgspec.Meta(ge=-1, le=1)]


class StereoSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The two stereo cameras, with a global shutter. Fields describe rectified images unless they say otherwise."""

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
    distortion: tuple[Coefficient, Coefficient, Coefficient, Coefficient, Coefficient] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3 of both lenses in OpenCV's model, in images before rectification."""
    right_rotation: tuple[MinusOneToOne, MinusOneToOne, MinusOneToOne] = (0.0, 0.0, 0.0)
    """Orientation of the right camera before rectification, in its rectified frame: rotation vector, radians."""
    noise: Annotated[float, msgspec.Meta(ge=0, le=100)] = 1.0
    """Factor of the image noise; 1 is the rc_visard's."""
    fps: Rate = 25.0
    """Maximum frame rate, Hz."""


class DepthSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Depth images."""

    range: tuple[Depth, Depth] = (0.1, 100.0)
    """Nearest and farthest depth, metres: the limits of the parameters ``mindepth`` and ``maxdepth``."""
    disparity_error: Annotated[float, msgspec.Meta(ge=0, le=5)] = 0.25
    """Standard deviation of the disparity on good texture, pixels of a camera image."""
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
