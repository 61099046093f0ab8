"""A click in the browser, as the viewer sends it to clients."""

from typing import Literal, TypeAlias

import msgspec

from scenegate.messages.changes import Path

Button: TypeAlias = Literal["left", "middle", "right"]


class Click(msgspec.Struct, frozen=True):
    """A click on geometry in the browser.

    Attributes:
        path: Path of the geometry.
        point: Point on the geometry in the world, metres.
    """

    path: Path
    point: tuple[float, float, float]
    button: Button
