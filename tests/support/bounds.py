"""The exact box of a scene."""

from gateway.scene.draw.bounds import Bounds, instance_bounds, union
from renderers.drawlist import DrawList


def scene_bounds(draw_list: DrawList) -> Bounds | None:
    """Return the box around all instances."""
    return union([box for box in instance_bounds(draw_list.instances) if box is not None])
