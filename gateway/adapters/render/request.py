"""What to render: a validated request for one image."""

from dataclasses import dataclass
from typing import Final, Literal

from gateway.scene.draw.style import LookChoice

ImageType = Literal["color", "depth", "label"]
MAX_FOCAL: Final = 1e9
"""Maximum focal length, pixels: a field of view of a hundred-thousandth of a radian in the largest image."""
MIN_FOV: Final = 2e-5
"""Minimum field of view, radians. A narrower one has a focal length above ``MAX_FOCAL`` in the largest image."""
MAX_FOV: Final = 3.1415926
"""Maximum field of view, radians. A wider one has a focal length below ``1 / MAX_FOCAL`` in the smallest image."""
MIN_FAR: Final = 1e-8
"""Minimum distance of the far plane, metres, so that there is room for a near plane."""
MAX_FAR: Final = 1e12
"""Maximum distance of the far plane, metres. With a larger one, float32 depth cannot resolve a scene."""


@dataclass(frozen=True, slots=True, eq=False)
class RenderRequest:
    """A validated request for one image."""

    image_type: ImageType
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    focal_x: float
    """Pixels, as in Drake's CameraInfo."""
    focal_y: float
    """Pixels."""
    center_x: float
    """Principal point in pixels from the left edge; pixel i covers i .. i + 1."""
    center_y: float
    """Principal point in pixels from the top edge."""
    near: float
    """Near plane in metres, >= 0. Drake prints six decimals: a value below 0.5 micrometres arrives as 0."""
    far: float
    """Far plane in metres, > near."""
    min_depth: float
    """Metres; closer depths are "too close". 0 unless the image is depth."""
    max_depth: float
    """Metres; larger depths are "too far". Infinite unless the image is depth."""
    scene: bytes | bytearray
    """The glTF file; must not change."""
    claimed_sha256: str | None = None
    """SHA-256 of the scene as sent by the client, 64 hexadecimal digits in lower case; None: not sent."""
    scene_filename: str = ""
    """File name as sent by the client; empty if it was not sent."""
    look: LookChoice | None = None
    """Shading model; None: the server's setting."""
    warnings: tuple[str, ...] = ()
    """Sentences about problems that do not prevent the image."""
