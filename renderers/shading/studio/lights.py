"""Lights as a table in the camera's optical frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import Light, LightKind

L_KIND: Final = 0  # 0 directional, 1 point, 2 spot
L_POSITION: Final = 1  # 3
L_DIRECTION: Final = 4  # 3, in which it shines
L_COLOR: Final = 7  # 3, times intensity
L_RANGE: Final = 10  # 1 / range^2, 0: none
L_SPOT_SCALE: Final = 11
L_SPOT_OFFSET: Final = 12
L_SHADOW: Final = 13  # row of the table of shadows, -1: none
L_COLUMNS: Final = 14

_KINDS: Final = {LightKind.DIRECTIONAL: 0.0, LightKind.POINT: 1.0, LightKind.SPOT: 2.0}


def light_table(lights: Sequence[Light], shadows: Sequence[int], camera: Camera) -> NDArray[np.float64]:
    """Return (n, L_COLUMNS) float64, at least one row.

    Args:
        shadows: each light's row in the table of shadows, or -1.
    """
    X = camera.X_camera_world
    table = np.zeros((max(len(lights), 1), L_COLUMNS))
    for row, light, shadow in zip(table, lights, shadows, strict=False):
        row[L_KIND] = _KINDS[light.kind]
        row[L_POSITION : L_POSITION + 3] = X[:3, :3] @ light.position + X[:3, 3]
        direction = X[:3, :3] @ light.direction
        row[L_DIRECTION : L_DIRECTION + 3] = direction / np.linalg.norm(direction)
        row[L_COLOR : L_COLOR + 3] = np.array(light.color) * light.intensity
        row[L_RANGE] = 0.0 if light.range is None else 1.0 / light.range**2
        # KHR_lights_punctual's reference for the cone: (cos - cos outer) / (cos inner - cos outer), squared.
        inner, outer = math.cos(light.inner_cone), math.cos(light.outer_cone)
        row[L_SPOT_SCALE] = 1.0 / max(inner - outer, 1e-3)
        row[L_SPOT_OFFSET] = -outer * row[L_SPOT_SCALE]
        row[L_SHADOW] = shadow
    return table
