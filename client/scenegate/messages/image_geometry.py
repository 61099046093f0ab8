"""Geometry types that Scenegate adds to Director's: images, heightmaps, text, camera frustums.

Other viewers reject them.

Lengths are in metres. Images and text lie in the plane z = 0 of the geometry's frame: rows and lines run along +x,
the top is towards +y, so that they are upright as seen from +z. They are not lit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from scenegate.messages.colors import check_color_count
from scenegate.messages.field_kinds import (
    Color,
    Extents,
    Heights,
    Image,
    LabelText,
    Number,
    Pixels,
    Positive,
    VertexColors,
    write_number,
)
from scenegate.messages.geometry import Geometry


class ImagePlane(Geometry, frozen=True):
    """An image on a rectangle that is centred on the origin.

    Attributes:
        image: A PNG or JPEG file as bytes, its path, or pixels, top row first: (H, W), (H, W, 3) or (H, W, 4), uint8 or
            floats from 0 to 1. ``color`` multiplies it.
        width: Extent along x; None: computed from ``height`` for square pixels.
        height: Extent along y; None: computed from ``width`` for square pixels.
    """

    kind = "image"
    image: Image
    width: Positive | None = None
    height: Positive | None = None

    def _fields(self) -> dict[str, Any]:
        if self.width is None and self.height is None:
            raise ValueError("an image plane needs width or height")
        return Geometry._fields(self)


class Heightmap(Geometry, frozen=True):
    """A surface over a rectangle in x and y that is centred on the origin.

    Attributes:
        heights: z at each point of a grid, (R, C) with R, C >= 2. x grows with the column and y with the row, as in
            ``numpy.meshgrid`` by default. NaN makes a hole.
        lengths: Extents of the rectangle along x and y.
        colors: A colour for each height, (R, C, 3) or (R, C, 4): floats from 0 to 1, or uint8. They multiply ``color``.
        image: Texture, as in ``ImagePlane``. Its first row lies along the first row of heights.
    """

    kind = "heightmap"
    heights: Heights
    lengths: Extents
    colors: VertexColors | None = None
    image: Image | None = None

    def _fields(self) -> dict[str, Any]:
        fields = Geometry._fields(self)
        shape = fields["heights"].shape
        if self.colors is not None:
            if np.ndim(self.colors) == 3 and np.shape(self.colors)[:2] != shape:
                raise ValueError(f"colors have shape {np.shape(self.colors)} for heights of shape {shape}")
            check_color_count(fields["colors"], math.prod(shape))
        return fields


class Text(Geometry, frozen=True):
    """Text on a rectangle that is centred on the origin. Characters that no font of the viewer has appear as boxes.

    Attributes:
        text: Up to 1000 characters. Newlines separate lines.
        size: Height of a line.
        background: Colour of the rectangle behind the letters, in any form of ``color``; None: no rectangle.
    """

    kind = "text"
    text: LabelText
    size: Positive = 0.1
    background: Color | None = None


class CameraFrustum(Geometry, frozen=True):
    """The edges of a camera's view in its optical frame: +z forward, +x right, +y down.

    Image size, focal length and principal point are in pixels, or all in another unit.

    Attributes:
        width: Width of the image.
        height: Height of the image.
        fx: Focal length along x.
        fy: Focal length along y; None: ``fx``.
        cx: Principal point from the left edge; None: the centre.
        cy: Principal point from the top edge; None: the centre.
        depth: Distance of the image plane from the camera, in metres.
        image: Image on the image plane, as in ``ImagePlane``; None: only the edges are shown.
        line_width: Width of the edges in pixels, 1 to 256; None: 1.
    """

    kind = "camera_frustum"
    width: Positive
    height: Positive
    fx: Positive
    fy: Positive | None = None
    cx: Number | None = None
    cy: Number | None = None
    depth: Positive = 0.3
    image: Image | None = None
    line_width: Pixels | None = None

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
        fovy = write_number("fovy", fovy)
        if not 0.0 < fovy < math.pi:
            raise ValueError(f"fovy must be between 0 and pi radians, not {fovy:g}")
        return cls(width=aspect, height=1.0, fx=0.5 / math.tan(0.5 * fovy), **options)
