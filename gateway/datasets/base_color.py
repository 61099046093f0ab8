"""Scenes that show base colours without light, for ``albedo`` images."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Final

from renderers.drawlist import AlphaMode, DrawList, Material
from renderers.interface import VTK_LOOKS, Look
from renderers.light_rig import Rig

BASE_COLOR_LOOK: Final = Look(
    "studio", (0, 0, 0), 1, Rig(surroundings=None, scene_lights=False, auto_exposure=False, tone="none", shadow_size=0)
)
"""Look that shows unlit materials as they are."""


@lru_cache(maxsize=2)
def unlit(draw_list: DrawList, look: Look) -> DrawList:
    """Return a draw list of unlit materials, with the cut-outs that the depth image has under a look."""
    materials = {id(each.material): each.material for each in draw_list.instances}
    unlit_materials = {key: _unlit_material(material, look) for key, material in materials.items()}
    instances = tuple(replace(each, material=unlit_materials[id(each.material)]) for each in draw_list.instances)
    return DrawList(instances, draw_list.images)


def _unlit_material(material: Material, look: Look) -> Material:
    """Return a material that shows the base colour on both sides."""
    mode, cutoff = material.alpha_mode, material.alpha_cutoff
    if look.name in VTK_LOOKS or (mode is AlphaMode.BLEND and look.alpha_threshold == 0.0):
        mode = AlphaMode.OPAQUE
    elif mode is AlphaMode.BLEND:
        mode, cutoff = AlphaMode.MASK, look.alpha_threshold
    return replace(material, unlit=True, alpha_mode=mode, alpha_cutoff=cutoff, double_sided=True)
