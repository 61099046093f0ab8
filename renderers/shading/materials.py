"""Materials as a look shades them, and the table of them that kernels read."""

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.color import srgb_from_linear
from renderers.drawlist import AlphaMode, Material, Sampler, Texture, Wrap
from renderers.interface import VTK_LOOKS, LookName
from renderers.shading.layout import LAMBERT, METALLIC_ROUGHNESS, UNLIT, ShadingMaterial
from renderers.shading.texture_table import TextureTable

VTK_PBR_ROUGHNESS: Final = 0.5
"""Roughness of VTK's own primitives under physically based shading: vtkProperty's default, whatever the exported
material says (the exporter writes a constant 1.0). Measured against RenderEngineVtk."""


def drawn_material(material: Material, look: LookName) -> Material:
    """Return the material that the look draws: in the looks of VTK, the one that VTK reads."""
    return material.fallback or material if look in VTK_LOOKS else material


def look_material(material: Material, look: LookName) -> Material:
    """Return the material as the look shades it. All deviations of materials from the glTF specification are here.

    - ``phong``, ``plain``: only the base colour, its texture and vertex colours are used, as RenderEngineVtk (without
      glTF meshes) and RenderEngineGl do.
    - ``plain``: the base colour factor is encoded as sRGB. (So are vertex colours, in the buffers of the mesh.)
    - ``phong``, ``pbr``: the material's ``fallback`` is used, every alpha blends, and textures are sampled as in VTK.
    - ``pbr``: emission needs an emissive texture, and occlusion a metallic-roughness texture. Textures of 16 bits are
      linear (``material_values``).
    - ``gltf``: occlusion has no effect, as it dims ambient light only (glTF 2.0, 3.9.3), and there is none.
    - ``pbr``, ``gltf``, ``studio``: materials written by VTK's exporter are dielectrics of roughness 0.5.
    """
    material = drawn_material(material, look)
    if look in VTK_LOOKS:
        material = _vtk_material(material)
    if look in ("phong", "plain"):
        if look == "plain":
            r, g, b, alpha = material.base_color
            encoded = (srgb_from_linear(r), srgb_from_linear(g), srgb_from_linear(b), alpha)
            material = replace(material, base_color=encoded)
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
    if look == "gltf" and material.occlusion_texture is not None:
        material = replace(material, occlusion_texture=None)
    if material.vtk_export:
        return replace(material, metallic=0.0, roughness=VTK_PBR_ROUGHNESS, metallic_roughness_texture=None)
    return material


def _vtk_material(material: Material) -> Material:
    """Return a glTF material as vtkGLTFImporter imports it."""
    metallic_roughness, emissive = material.metallic_roughness_texture, material.emissive_texture
    return replace(
        material,
        base_color_texture=_with_vtk_sampler(material.base_color_texture),
        metallic_roughness_texture=_with_vtk_sampler(metallic_roughness),
        normal_texture=_with_vtk_sampler(material.normal_texture),
        occlusion_texture=_with_vtk_sampler(material.occlusion_texture if metallic_roughness is not None else None),
        emissive_texture=_with_vtk_sampler(emissive),
        emissive=material.emissive if emissive is not None else (0.0, 0.0, 0.0),
        alpha_mode=AlphaMode.BLEND,
    )


def _with_vtk_sampler(texture: Texture | None) -> Texture | None:
    """Return the texture with the sampler that VTK uses in place of its own.

    VTK's textures have one wrap mode for both axes and do not mirror. They are filtered linearly, and between mip
    levels if the sampler uses them. Only if all filters of the sampler are nearest-texel ones, the nearest texel is
    used.
    """
    if texture is None:
        return None
    sampler = texture.sampler
    is_clamped = Wrap.CLAMP_TO_EDGE in (sampler.wrap_s, sampler.wrap_t)
    wrap = Wrap.CLAMP_TO_EDGE if is_clamped else Wrap.REPEAT
    is_nearest = not (sampler.mag_linear or sampler.min_linear or (sampler.mipmaps and sampler.mip_linear))
    is_linear, mipmaps = not is_nearest, sampler.mipmaps and not is_nearest
    return replace(texture, sampler=Sampler(wrap, wrap, is_linear, is_linear, mipmaps))


COLORS_REPLACE: Final = 1
"""Bit: vertex colours replace the colour of the base colour factor, but not its alpha. Otherwise they multiply it."""
COLORS_DECODE: Final = 2
"""Bit: vertex colours are raised to the power of 2.2 before they are used."""

ALPHA_OPAQUE: Final = 0
ALPHA_MASK: Final = 1
ALPHA_BLEND: Final = 2
_ALPHA_MODES: Final = {AlphaMode.OPAQUE: ALPHA_OPAQUE, AlphaMode.MASK: ALPHA_MASK, AlphaMode.BLEND: ALPHA_BLEND}


def vertex_color_rule(material: Material, look: LookName) -> int:
    """Return the COLORS_ bits that say how a mesh's vertex colours change the base colour.

    RenderEngineVtk with glTF meshes replaces the base colour factor by the vertex colours. Recent versions raise them
    to 2.2. (Measured: mean error 0.3 levels, against 14 for glTF's linear product.) For lines, points and unlit
    surfaces, it multiplies vertex colours by the factor.
    """
    if look != "pbr":
        return 0
    decode = COLORS_DECODE if material.decodes_vertex_colors else 0
    return decode if material.unlit else decode | COLORS_REPLACE


def reflectance(ior: float) -> float:
    """Return the reflectance of a dielectric in air at normal incidence (KHR_materials_ior); ``ior`` 0: of a mirror."""
    return 1.0 if ior == 0.0 else ((ior - 1.0) / (ior + 1.0)) ** 2


class MaterialTable:
    """Collects the MATERIALs of one draw list under one look."""

    def __init__(self, look: LookName, textures: TextureTable) -> None:
        self._look = look
        self._textures = textures
        self._indices: dict[tuple[int, bool], int] = {}
        self._values: list[dict[str, Any]] = []
        self.materials: list[Material] = []
        """The materials of the draw list in the order of the table."""

    def index_of(self, material: Material, lit: bool) -> int:
        """Return the index of a material, which is added if it is new.

        ``lit`` is False for lines and points, which have no surface to be lit.
        """
        index = self._indices.setdefault((id(material), lit), len(self._values))
        if index == len(self._values):
            self._values.append(material_values(material, self._look, lit, self._textures))
            self.materials.append(material)
        return index

    def has_normal_map(self, index: int) -> bool:
        """Return True if the material at this index reads a normal map."""
        return bool(self._values[index]["normal_texture"] >= 0)

    def structs(self) -> NDArray[Any]:
        """Return (n,) ShadingMaterial, at least one."""
        structs = np.zeros(max(len(self._values), 1), ShadingMaterial.dtype)
        with np.errstate(over="ignore"):  # a factor beyond the range of float32 becomes infinite
            for k, values in enumerate(self._values):
                structs[k] = ShadingMaterial.record(**values)
        return structs


def _lighting(material: Material, look: LookName) -> int:
    if material.unlit:
        return UNLIT
    return LAMBERT if material.lambert or look in ("phong", "plain") else METALLIC_ROUGHNESS


def material_values(material: Material, look: LookName, lit: bool, textures: TextureTable) -> dict[str, Any]:
    """Return the fields of a ShadingMaterial, by name; its textures are added to ``textures``."""
    adapted = look_material(material if lit else replace(material, unlit=True), look)
    lit = not adapted.unlit
    # A metal without a texture has no dielectric part.
    has_specular = look == "studio" and (adapted.metallic < 1.0 or adapted.metallic_roughness_texture is not None)
    uv_sets = 0
    reads_gradients = False

    def index_of(texture: Texture | None, is_read: bool, srgb: bool = False) -> int:
        nonlocal uv_sets, reads_gradients
        if texture is None or not is_read:
            return -1
        uv_sets |= 1 << texture.uv_set
        reads_gradients |= texture.sampler.depends_on_scale or look == "gltf"
        return textures.index_of(texture, srgb and not (look == "pbr" and texture.image.sixteen_bits))

    strength = adapted.emissive_strength if look == "studio" else 1.0
    values: dict[str, Any] = {
        "alpha_mode": _ALPHA_MODES[adapted.alpha_mode],
        "lighting": _lighting(adapted, look),
        "encodes_gamma": int(look in ("pbr", "gltf") and not adapted.lambert),
        "vertex_color_rule": vertex_color_rule(adapted, look),
        "base_color_texture": index_of(adapted.base_color_texture, True, look in ("pbr", "gltf", "studio")),
        "metallic_roughness_texture": index_of(adapted.metallic_roughness_texture, lit),
        "normal_texture": index_of(adapted.normal_texture, lit),
        "occlusion_texture": index_of(adapted.occlusion_texture, lit and adapted.occlusion_strength != 0.0),
        "emissive_texture": index_of(adapted.emissive_texture, lit and any(adapted.emissive), True),
        "specular_texture": index_of(adapted.specular_texture, lit and has_specular),
        "specular_color_texture": index_of(adapted.specular_color_texture, lit and has_specular, True),
        "base_color": adapted.base_color,
        "metallic": adapted.metallic,
        "roughness": adapted.roughness,
        "normal_scale": adapted.normal_scale,
        "occlusion_strength": adapted.occlusion_strength,
        "emissive": tuple((value * strength if lit else 0.0) for value in adapted.emissive),
        "alpha_cutoff": adapted.alpha_cutoff,
        "reflectance": reflectance(adapted.ior),
        "specular": adapted.specular,
        "specular_color": adapted.specular_color,
    }
    return {**values, "uv_sets": uv_sets, "reads_gradients": reads_gradients}
