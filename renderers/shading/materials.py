"""What a material means under a look, and its row in the kernels' tables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from renderers.color import srgb_from_linear
from renderers.drawlist import AlphaMode, Material, Texture
from renderers.interface import LookName
from renderers.shading.textures import TextureTable

VTK_PBR_ROUGHNESS: Final = 0.5
"""VTK's own primitives under its physically based shading have vtkProperty's default roughness, whatever the
exported material says (its exporter writes a constant 1.0). Measured against RenderEngineVtk."""


def look_material(material: Material, look: LookName) -> Material:
    """The material as the look shades it: the one place for what engines do apart from the glTF specification.

    ``pbr``: materials that VTK's exporter wrote are dielectrics of roughness 0.5.
    ``phong``: only base colour, its texture and the vertex colours are seen; normal, metallic-roughness, occlusion
    and emissive are dropped, as RenderEngineVtk (without glTF meshes) and RenderEngineGl do.
    ``plain``: as ``phong``, with the base colour factor as displays show it.
    """
    if look != "pbr":
        if look == "plain":
            r, g, b, alpha = material.base_color
            shown = (srgb_from_linear(r), srgb_from_linear(g), srgb_from_linear(b), alpha)
            material = replace(material, base_color=shown)
        unseen = (
            material.normal_texture,
            material.metallic_roughness_texture,
            material.occlusion_texture,
            material.emissive_texture,
        )
        if not any(unseen) and not any(material.emissive):
            return material  # metallic and roughness have no effect
        return replace(
            material,
            metallic_roughness_texture=None,
            normal_texture=None,
            occlusion_texture=None,
            emissive=(0.0, 0.0, 0.0),
            emissive_texture=None,
        )
    if material.vtk_export:
        return replace(material, metallic=0.0, roughness=VTK_PBR_ROUGHNESS, metallic_roughness_texture=None)
    return material


# Columns of the integer table.
MI_ALPHA_MODE: Final = 0
MI_UNLIT: Final = 1
MI_BASE: Final = 2
MI_METALLIC_ROUGHNESS: Final = 3
MI_NORMAL: Final = 4
MI_OCCLUSION: Final = 5
MI_EMISSIVE: Final = 6
MI_UV: Final = 7
MI_COLORS: Final = 8
MI_COLUMNS: Final = 9
"""Texture columns hold a row of the texture table or -1. ``MI_UV``: bit 0 / 1: the set uv0 / uv1 is read."""

COLORS_MULTIPLY: Final = 0
"""Vertex colours multiply the base colour as they are."""
COLORS_DECODE: Final = 1
"""They are as shown in a picture: raised to 2.2 they multiply the base colour."""
COLORS_REPLACE: Final = 2
"""They are as shown, and stand for the colour of the base colour factor (not for its alpha)."""

# Columns of the float table.
MF_BASE: Final = 0  # 4 values
MF_METALLIC: Final = 4
MF_ROUGHNESS: Final = 5
MF_NORMAL_SCALE: Final = 6
MF_OCCLUSION: Final = 7
MF_EMISSIVE: Final = 8  # 3 values
MF_CUTOFF: Final = 11
MF_COLUMNS: Final = 12

ALPHA_OPAQUE: Final = 0
ALPHA_MASK: Final = 1
ALPHA_BLEND: Final = 2
_ALPHA: Final = {AlphaMode.OPAQUE: ALPHA_OPAQUE, AlphaMode.MASK: ALPHA_MASK, AlphaMode.BLEND: ALPHA_BLEND}


def vertex_color_rule(material: Material, look: LookName) -> int:
    """How a mesh's vertex colours enter the base colour.

    RenderEngineVtk with glTF meshes raises interpolated vertex colours to 2.2 and lets them replace the base colour
    factor (measured: mean error 0.3 levels, against 14 for glTF's linear product). Colours of lines, points and
    unlit surfaces are shown as they are given, times the factor.
    """
    if look != "pbr":
        return COLORS_MULTIPLY
    return COLORS_DECODE if material.unlit else COLORS_REPLACE


@dataclass(frozen=True, slots=True)
class MaterialRows:
    """One material's rows."""

    integers: tuple[int, ...]
    floats: tuple[float, ...]

    @property
    def needs_tangents(self) -> bool:
        return self.integers[MI_NORMAL] >= 0


def material_rows(material: Material, look: LookName, lit: bool, textures: TextureTable) -> MaterialRows:
    """Rows of one material; its textures are added to ``textures``.

    Args:
        lit: False for lines and points, which have no surface that could be lit.
    """
    seen = look_material(material if lit else replace(material, unlit=True), look)
    used: list[Texture] = []

    def row(texture: Texture | None) -> int:
        if texture is None:
            return -1
        used.append(texture)
        return textures.row(texture)

    emits = any(seen.emissive)
    texture_rows = (
        row(seen.base_color_texture),
        row(seen.metallic_roughness_texture if not seen.unlit else None),
        row(seen.normal_texture if not seen.unlit else None),
        row(seen.occlusion_texture if not seen.unlit and seen.occlusion_strength != 0.0 else None),
        row(seen.emissive_texture if not seen.unlit and emits else None),
    )
    uv = 0
    for texture in used:
        uv |= 2 if texture.uv_set == 1 else 1
    return MaterialRows(
        integers=(_ALPHA[seen.alpha_mode], int(seen.unlit), *texture_rows, uv, vertex_color_rule(seen, look)),
        floats=(
            *seen.base_color,
            seen.metallic,
            seen.roughness,
            seen.normal_scale,
            seen.occlusion_strength,
            *((0.0, 0.0, 0.0) if seen.unlit else seen.emissive),
            seen.alpha_cutoff,
        ),
    )


def as_tables(rows: list[MaterialRows]) -> tuple[np.ndarray, np.ndarray]:
    """(n, MI_COLUMNS) int64 and (n, MF_COLUMNS) float32, at least one row each."""
    if not rows:
        return np.full((1, MI_COLUMNS), -1, np.int64), np.zeros((1, MF_COLUMNS), np.float32)
    with np.errstate(over="ignore"):  # a posted factor beyond float32 is infinite
        floats = np.array([r.floats for r in rows], dtype=np.float32)
    return np.array([r.integers for r in rows], dtype=np.int64), floats
