"""Geometry types that Scenegate adds to Director's: images, heightmaps, text, camera frustums.

Other viewers reject them.

Lengths are in metres. Images and text lie in the plane z = 0 of the geometry's frame: rows and lines run along +x,
the top is towards +y, so that they are upright as seen from +z. They are not lit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scenegate.messages.colors import ImageLike, color_rows, image_field, rgba
from scenegate.messages.geometry import Geometry, number_list, number_rows


@dataclass(frozen=True, slots=True)
class ImagePlane(Geometry):
    """An image on a rectangle that is centred on the origin."""

    kind = "image"
    image: ImageLike
    """A PNG or JPEG file as bytes, its path, or pixels, top row first: (H, W), (H, W, 3) or (H, W, 4), uint8 or floats
    from 0 to 1. ``color`` multiplies it."""
    width: float | None = None
    """Extent along x; None: computed from ``height`` for square pixels."""
    height: float | None = None
    """Extent along y; None: computed from ``width`` for square pixels."""

    def _fields(self) -> dict[str, Any]:
        if self.width is None and self.height is None:
            raise ValueError("an image plane needs width or height")
        sizes = {"width": self.width, "height": self.height}
        return {
            "image": image_field(self.image),
            **{name: float(size) for name, size in sizes.items() if size is not None},
        }


@dataclass(frozen=True, slots=True)
class Heightmap(Geometry):
    """A surface over a rectangle in x and y that is centred on the origin."""

    kind = "heightmap"
    heights: ArrayLike
    """z at each point of a grid, (R, C) with R, C >= 2. x grows with the column and y with the row, as in
    ``numpy.meshgrid`` by default. NaN makes a hole."""
    lengths: Sequence[float]
    """Extents of the rectangle along x and y."""
    colors: ArrayLike | None = None
    """A colour for each height, (R, C, 3) or (R, C, 4): floats from 0 to 1, or uint8. They multiply ``color``."""
    image: ImageLike | None = None
    """Texture, as in ``ImagePlane``. Its first row lies along the first row of heights."""

    def _fields(self) -> dict[str, Any]:
        shape = np.shape(self.heights)
        if len(shape) != 2 or min(shape) < 2:
            raise ValueError(f"heights must have at least 2 rows of 2 numbers, not shape {shape}")
        if self.colors is not None and np.ndim(self.colors) == 3 and np.shape(self.colors)[:2] != shape:
            raise ValueError(f"colors have shape {np.shape(self.colors)} for heights of shape {shape}")
        colors = {} if self.colors is None else {"colors": color_rows("colors", self.colors, math.prod(shape))}
        return {
            "heights": number_rows("heights", self.heights, shape[1]),
            "lengths": number_list("lengths", self.lengths, 2),
            **colors,
            **({} if self.image is None else {"image": image_field(self.image)}),
        }


@dataclass(frozen=True, slots=True)
class Text(Geometry):
    """Text on a rectangle that is centred on the origin. Characters that no font of the viewer has appear as boxes."""

    kind = "text"
    text: str
    """Up to 1000 characters. Newlines separate lines."""
    size: float = 0.1
    """Height of a line."""
    background: ArrayLike | None = None
    """Colour of the rectangle behind the letters, in any form of ``color``; None: no rectangle."""

    def _fields(self) -> dict[str, Any]:
        background = {} if self.background is None else {"background": rgba(self.background)}
        return {"text": str(self.text), "size": float(self.size), **background}


@dataclass(frozen=True, slots=True)
class CameraFrustum(Geometry):
    """The edges of a camera's view in its optical frame: +z forward, +x right, +y down.

    Image size, focal length and principal point are in pixels, or all in another unit.
    """

    kind = "camera_frustum"
    width: float
    """Width of the image."""
    height: float
    """Height of the image."""
    fx: float
    """Focal length along x."""
    fy: float | None = None
    """Focal length along y; None: ``fx``."""
    cx: float | None = None
    """Principal point from the left edge; None: the centre."""
    cy: float | None = None
    """Principal point from the top edge; None: the centre."""
    depth: float = 0.3
    """Distance of the image plane from the camera, in metres."""
    image: ImageLike | None = None
    """Image on the image plane, as in ``ImagePlane``; None: only the edges are shown."""
    line_width: float | None = None
    """Width of the edges in pixels, 1 to 256; None: 1."""

    @classmethod
    def from_fov(cls, fovy: float, aspect: float = 4.0 / 3.0, **options: Any) -> CameraFrustum:
        """Return the frustum of a camera with a vertical field of view, in units of the image's height.

        Args:
            fovy: Angle from the bottom to the top edge, radians.
            aspect: Width divided by height.
            options: Other fields, such as ``depth`` and ``image``.

        Raises:
            ValueError: ``fovy`` is not between 0 and pi, such as an angle in degrees.
        """
        if not 0.0 < fovy < math.pi:
            raise ValueError(f"fovy must be between 0 and pi radians, not {fovy:g}")
        return cls(width=aspect, height=1.0, fx=0.5 / math.tan(0.5 * fovy), **options)

    def _fields(self) -> dict[str, Any]:
        names = ("width", "height", "fx", "fy", "cx", "cy", "depth", "line_width")
        values = {name: getattr(self, name) for name in names}
        fields: dict[str, Any] = {name: float(value) for name, value in values.items() if value is not None}
        return fields if self.image is None else fields | {"image": image_field(self.image)}
