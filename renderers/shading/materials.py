"""Materials as a look shades them, and their rows in the kernels' tables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.color import srgb_from_linear
from renderers.drawlist import AlphaMode, Material, Texture
from renderers.interface import LookName
from renderers.shading.texture_table import TextureTable

VTK_PBR_ROUGHNESS: Final = 0.5
"""Roughness of VTK's own primitives under physically based shading: vtkProperty's default, whatever the exported
material says (the exporter writes a constant 1.0). Measured against RenderEngineVtk."""


def look_material(material: Material, look: LookName) -> Material:
    """Return the material as the look shades it: the one place for deviations from the glTF specification.

    ``phong``: base colour, its texture and vertex colours only. Normal, metallic-roughness, occlusion and emissive are
    dropped, as RenderEngineVtk (without glTF meshes) and RenderEngineGl do.
    ``plain``: as ``phong``, with the base colour factor encoded as sRGB.
    ``pbr``, ``studio``: materials written by VTK's exporter are dielectrics of roughness 0.5.
    """
    if look in ("phong", "plain"):
        if look == "plain":
            r, g, b, alpha = material.base_color
            shown = (srgb_from_linear(r), srgb_from_linear(g), srgb_from_linear(b), alpha)
            material = replace(material, base_color=shown)
        dropped = (
            material.normal_texture,
            material.metallic_roughness_texture,
            material.occlusion_texture,
            material.emissive_texture,
        )
        if not any(dropped) and not any(material.emissive):
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


# Columns of the integer table. Texture columns hold a row of the texture table or -1.
MI_ALPHA_MODE: Final = 0
MI_UNLIT: Final = 1
MI_BASE: Final = 2
MI_METALLIC_ROUGHNESS: Final = 3
MI_NORMAL: Final = 4
MI_OCCLUSION: Final = 5
MI_EMISSIVE: Final = 6
MI_SPECULAR: Final = 7  # look ``studio`` only, as the next one
MI_SPECULAR_COLOR: Final = 8
MI_UV: Final = 9  # bits 0 and 1: the sets uv0 and uv1 are read
MI_COLORS: Final = 10  # COLORS_ constant
MI_COLUMNS: Final = 11

COLORS_MULTIPLY: Final = 0
"""Vertex colours multiply the base colour."""
COLORS_DECODE: Final = 1
"""Vertex colours raised to 2.2 multiply the base colour."""
COLORS_REPLACE: Final = 2
"""Vertex colours raised to 2.2 replace the colour of the base colour factor, but not its alpha."""

# Columns of the float table.
MF_BASE: Final = 0  # 4 values
MF_METALLIC: Final = 4
MF_ROUGHNESS: Final = 5
MF_NORMAL_SCALE: Final = 6
MF_OCCLUSION: Final = 7
MF_EMISSIVE: Final = 8  # 3 values; look ``studio``: times the strength
MF_CUTOFF: Final = 11
MF_REFLECTANCE: Final = 12  # of the dielectric at normal incidence; look ``studio`` only, as the next ones
MF_SPECULAR: Final = 13
MF_SPECULAR_COLOR: Final = 14  # 3 values
MF_COLUMNS: Final = 17

ALPHA_OPAQUE: Final = 0
ALPHA_MASK: Final = 1
ALPHA_BLEND: Final = 2
_ALPHA: Final = {AlphaMode.OPAQUE: ALPHA_OPAQUE, AlphaMode.MASK: ALPHA_MASK, AlphaMode.BLEND: ALPHA_BLEND}


def vertex_color_rule(material: Material, look: LookName) -> int:
    """Return the COLORS_ constant: how a mesh's vertex colours enter the base colour.

    RenderEngineVtk with glTF meshes raises interpolated vertex colours to 2.2 and replaces the base colour factor by
    them (measured: mean error 0.3 levels, against 14 for glTF's linear product). Lines, points and unlit surfaces show
    their vertex colours as given, times the factor.
    """
    if look != "pbr":
        return COLORS_MULTIPLY
    return COLORS_DECODE if material.unlit else COLORS_REPLACE


def reflectance(ior: float) -> float:
    """Return the reflectance at normal incidence of a dielectric in air (KHR_materials_ior). 0: total reflection."""
    return 1.0 if ior == 0.0 else ((ior - 1.0) / (ior + 1.0)) ** 2


@dataclass(frozen=True, slots=True)
class MaterialRows:
    """One material's rows."""

    integers: tuple[int, ...]
    floats: tuple[float, ...]

    @property
    def has_normal_map(self) -> bool:
        return self.integers[MI_NORMAL] >= 0


def material_rows(material: Material, look: LookName, lit: bool, textures: TextureTable) -> MaterialRows:
    """Return the rows of one material; its textures are added to ``textures``.

    Args:
        lit: False for lines and points, which have no surface.
    """
    shown = look_material(material if lit else replace(material, unlit=True), look)
    lit = not shown.unlit
    # A metal without a texture has no dielectric part.
    dielectric = shown.metallic < 1.0 or shown.metallic_roughness_texture is not None
    uv = 0

    def row(texture: Texture | None, used: bool, srgb: bool = False) -> int:
        nonlocal uv
        if texture is None or not used:
            return -1
        uv |= 2 if texture.uv_set == 1 else 1
        return textures.row(texture, srgb)

    texture_rows = (
        row(shown.base_color_texture, True, look in ("pbr", "studio")),
        row(shown.metallic_roughness_texture, lit),
        row(shown.normal_texture, lit),
        row(shown.occlusion_texture, lit and shown.occlusion_strength != 0.0),
        row(shown.emissive_texture, lit and any(shown.emissive), True),
        row(shown.specular_texture, lit and dielectric and look == "studio"),
        row(shown.specular_color_texture, lit and dielectric and look == "studio", True),
    )
    strength = shown.emissive_strength if look == "studio" else 1.0
    return MaterialRows(
        integers=(_ALPHA[shown.alpha_mode], int(not lit), *texture_rows, uv, vertex_color_rule(shown, look)),
        floats=(
            *shown.base_color,
            shown.metallic,
            shown.roughness,
            shown.normal_scale,
            shown.occlusion_strength,
            *((value * strength if lit else 0.0) for value in shown.emissive),
            shown.alpha_cutoff,
            reflectance(shown.ior),
            shown.specular,
            *shown.specular_color,
        ),
    )


def as_tables(rows: list[MaterialRows]) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return (n, MI_COLUMNS) int64 and (n, MF_COLUMNS) float32, at least one row each."""
    if not rows:
        return np.full((1, MI_COLUMNS), -1, np.int64), np.zeros((1, MF_COLUMNS), np.float32)
    with np.errstate(over="ignore"):  # a posted factor beyond float32 is infinite
        floats = np.array([row.floats for row in rows], np.float32)
    return np.array([row.integers for row in rows], np.int64), floats
