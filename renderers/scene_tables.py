"""What every look's tables of a draw list have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.drawlist import AlphaMode, Image, Instance


@dataclass(frozen=True, slots=True, eq=False)
class SceneTables:
    """What the kernels of a look read of a draw list; independent of the camera, shared between threads."""

    instances: NDArray[np.int64]
    """(n, II_COLUMNS) of the look."""
    material_integers: NDArray[np.int64]
    """(m, MI_COLUMNS)."""
    material_floats: NDArray[np.float32]
    """(m, MF_COLUMNS)."""
    texture_integers: NDArray[np.int64]
    """(t, TI_COLUMNS)."""
    texture_floats: NDArray[np.float32]
    """(t, TF_COLUMNS)."""
    cull_back: NDArray[np.bool_]
    """(n,): whose back faces colour does not show."""
    layered: NDArray[np.bool_]
    """(n,): who may let something behind it be seen: blended or cut out, and not opaque everywhere."""
    keep: tuple[Any, ...]
    """What the addresses in the tables point into."""


def lets_through(instance: Instance, opaque: Callable[[Image], bool]) -> bool:
    """Whether something behind may be seen through the instance.

    Args:
        opaque: whether an image has no transparent texel.
    """
    material = instance.material
    if material.alpha_mode is AlphaMode.OPAQUE:
        return False
    texture = material.base_color_texture
    everywhere = instance.mesh.colors is None and (texture is None or opaque(texture.image))
    least = material.alpha_cutoff if material.alpha_mode is AlphaMode.MASK else 1.0
    return not (everywhere and material.base_color[3] >= least)
