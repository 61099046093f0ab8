"""Materials of a document, and the labels that Drake's client encodes in them."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, Final, TypeVar

from gateway.files.gltf import schema
from gateway.files.gltf.gltf_errors import as_warning, checked_item
from gateway.files.gltf.parser import extension, vector_or_default
from gateway.files.gltf.textures import Textures
from renderers.drawlist import LABEL_NONE, AlphaMode, Material, Mesh, Texture

DEFAULT_MATERIAL: Final = Material(metallic=0.0, fallback=Material(metallic=0.0, roughness=0.5, double_sided=True))
"""Material of primitives without one: white and not metallic, as RenderEngineVtk shows it. Compare by ``is``."""

_NEVER_FROM_VTK: Final = frozenset({"NORMAL", "COLOR_0"})
"""Attributes that VTK's exporter never writes in documents from Drake (only POSITION and TEXCOORD_0)."""
_ROUNDING: Final = 1e-3
"""Factors beyond 0 or 1 by less than this have no warning."""
_WHITE: Final = (1.0, 1.0, 1.0, 1.0)
_ALPHA_MODES: Final[dict[str | None, AlphaMode]] = {None: AlphaMode.OPAQUE} | {mode.value: mode for mode in AlphaMode}
_GLOSSINESS: Final = "KHR_materials_pbrSpecularGlossiness"
_TRANSMISSION: Final = "KHR_materials_transmission"
_VARIANTS: Final = "KHR_materials_variants"
_DIELECTRIC_REFLECTANCE: Final = 0.04
"""Reflectance at normal incidence for an index of refraction of 1.5."""

_Extension = TypeVar("_Extension", bound=schema.Object)


def label_from_material(material: Material) -> int:
    """Return the label that Drake's client encodes in a material of a label request, red in the low byte.

    The client sends each label as a linear ``baseColorFactor`` of 8-bit steps, ``[r / 255, g / 255, b / 255, 1]``,
    whatever extensions the material has. A primitive without a material carries no label.
    """
    if material is DEFAULT_MATERIAL:
        return LABEL_NONE
    base_color = (material.fallback or material).base_color
    red, green, blue = (round(255.0 * min(1.0, max(0.0, factor))) for factor in base_color[:3])
    return red | green << 8 | blue << 16


class Materials:
    """The materials of one document, each read at its first use."""

    def __init__(
        self,
        document: schema.Document,
        textures: Textures,
        warnings: list[str],
        variant: str | None = None,
        *,
        from_drake: bool = False,
    ) -> None:
        """``from_drake``: True for a document from Drake's render client. ``variant``: as for ``read_gltf``."""
        self._sources = document.materials
        self._warnings = warnings
        self._variant = None if variant is None else _variant_index(document, variant, warnings)
        self._textures = textures
        self._from_drake = from_drake
        self._decodes_vertex_colors = not document.from_old_drake
        self._materials: dict[tuple[int, bool], Material] = {}
        """Materials by index in the document, and True if VTK's exporter wrote the primitive."""

    def get(self, primitive: schema.GltfPrimitive, name: str) -> Material:
        """Return the material of a primitive; ``DEFAULT_MATERIAL`` without a readable one. Raises GltfLimitError."""
        with as_warning(self._warnings, f"{name} has the default material"):
            index = self._material_index(primitive, name)
            if index is None:
                return DEFAULT_MATERIAL
            from_vtk = self.is_from_vtk(primitive)
            material = self._materials.get((index, from_vtk))
            if material is None:
                source = checked_item(self._sources, index, "materials", f"{name}.material")
                material = self._materials[index, from_vtk] = self._read(source, f"materials[{index}]", from_vtk)
            return material
        return DEFAULT_MATERIAL

    def _material_index(self, primitive: schema.GltfPrimitive, name: str) -> int | None:
        """Return the index of a primitive's material in the variant, or else its default; None if it has neither."""
        if self._variant is None:
            return primitive.material
        found = extension(primitive.extensions, _VARIANTS, schema.VariantMappings, name, self._warnings)
        for mapping in (found and found.mappings) or ():
            if isinstance(mapping, schema.VariantMapping) and self._variant in (mapping.variants or ()):
                return mapping.material
        return primitive.material

    def is_from_vtk(self, primitive: schema.GltfPrimitive) -> bool:
        """Return True for a primitive of VTK's exporter for Drake's client, which never writes normals nor colours."""
        return self._from_drake and resembles_drake(primitive, self._sources or [])

    def _read(self, source: schema.GltfMaterial, name: str, from_vtk: bool) -> Material:
        """Read a material. ``from_vtk``: its exporter writes neither ``alphaMode`` nor ``doubleSided``."""
        pbr = source.pbr_metallic_roughness or schema.MetallicRoughness()
        base_color = self._vector(pbr.base_color_factor, f"{name}.pbrMetallicRoughness.baseColorFactor", _WHITE)
        if not all(-_ROUNDING <= factor <= 1.0 + _ROUNDING for factor in base_color):
            self._warnings.append(f"{name}.pbrMetallicRoughness.baseColorFactor: {base_color} is not from 0 to 1")
        is_vtk_blended = from_vtk and base_color[3] < 1.0
        normal, occlusion, read_texture = source.normal_texture, source.occlusion_texture, self._textures.get
        material = Material(
            base_color=base_color,
            base_color_texture=read_texture(pbr.base_color_texture, f"{name}.baseColorTexture"),
            metallic=self._factor(pbr.metallic_factor, f"{name}.pbrMetallicRoughness.metallicFactor"),
            roughness=self._factor(pbr.roughness_factor, f"{name}.pbrMetallicRoughness.roughnessFactor"),
            metallic_roughness_texture=read_texture(pbr.metallic_roughness_texture, f"{name}.metallicRoughnessTexture"),
            normal_texture=read_texture(normal, f"{name}.normalTexture"),
            normal_scale=_or_default(normal.scale if normal else None, 1.0),
            occlusion_texture=read_texture(occlusion, f"{name}.occlusionTexture"),
            occlusion_strength=self._factor(
                occlusion.strength if occlusion else None, f"{name}.occlusionTexture.strength"
            ),
            emissive=self._vector(source.emissive_factor, f"{name}.emissiveFactor", (0.0, 0.0, 0.0)),
            emissive_texture=read_texture(source.emissive_texture, f"{name}.emissiveTexture"),
            alpha_mode=AlphaMode.BLEND if is_vtk_blended else self._alpha_mode(source.alpha_mode, name),
            alpha_cutoff=_or_default(source.alpha_cutoff, 0.5),
            double_sided=bool(source.double_sided) or from_vtk,
            vtk_export=from_vtk,
            decodes_vertex_colors=self._decodes_vertex_colors,
        )
        return self._with_extensions(material, source, name) if source.extensions else material

    def _vector(self, values: list[float] | None, path: str, default: tuple[float, ...]) -> tuple[Any, ...]:
        return vector_or_default(values, path, default, self._warnings)

    def _factor(self, value: float | None, path: str, default: float = 1.0) -> float:
        """Return a factor clamped to 0 .. 1, with a warning if it was not."""
        if value is None:
            return default
        clamped = min(1.0, max(0.0, float(value)))
        if abs(clamped - value) > _ROUNDING:
            self._warnings.append(f"{path}: {value:g} is not from 0 to 1; {clamped:g} is used")
        return clamped

    def _alpha_mode(self, value: str | None, name: str) -> AlphaMode:
        mode = _ALPHA_MODES.get(value)
        if mode is None:
            self._warnings.append(f"{name}.alphaMode: {value!r:.30} is not OPAQUE, MASK or BLEND; OPAQUE is used")
        return mode or AlphaMode.OPAQUE

    def _with_extensions(self, material: Material, source: schema.GltfMaterial, name: str) -> Material:
        """Return the material with its extensions. Its ``fallback`` is the one without the two that VTK ignores."""

        def read(key: str, type_: type[_Extension]) -> _Extension | None:
            return extension(source.extensions, key, type_, name, self._warnings)

        strength = read("KHR_materials_emissive_strength", schema.EmissiveStrength) or schema.EmissiveStrength()
        ior = read("KHR_materials_ior", schema.Ior) or schema.Ior()
        specular = read("KHR_materials_specular", schema.Specular) or schema.Specular()
        material = replace(
            material,
            emissive_strength=max(0.0, _or_default(strength.emissive_strength, 1.0)),
            unlit=read("KHR_materials_unlit", schema.Object) is not None,
            ior=_ior(ior.ior),
            specular=self._factor(specular.specular_factor, f"{name}.specularFactor"),
            specular_texture=self._textures.get(specular.specular_texture, f"{name}.specularTexture"),
            specular_color=self._vector(specular.specular_color_factor, f"{name}.specularColorFactor", (1.0, 1.0, 1.0)),
            specular_color_texture=self._textures.get(specular.specular_color_texture, f"{name}.specularColorTexture"),
        )
        as_in_vtk = material
        glossiness = read(_GLOSSINESS, schema.SpecularGlossiness)
        if glossiness:
            material = self._with_glossiness(material, glossiness, name)
        transmission = read(_TRANSMISSION, schema.Transmission)
        if transmission:
            material = self._with_transmission(material, transmission, name)
        return material if material is as_in_vtk else replace(material, fallback=as_in_vtk)

    def _with_transmission(self, material: Material, source: schema.Transmission, name: str) -> Material:
        """Return a transmissive material as a blended one.

        The material lets a share of the light from behind pass: the transmission, times the strongest channel of the
        base colour, less what both faces reflect. Clear glass therefore stays visible. The light is neither refracted
        nor tinted.
        """
        factor = self._factor(source.transmission_factor, f"{name}.transmissionFactor", 0.0)
        passed = factor * (1.0 - material.metallic) * min(max(*material.base_color[:3], 0.0), 1.0)
        if passed == 0.0 or material.alpha_mode is AlphaMode.MASK:
            return material
        if source.transmission_texture is not None:
            self._warnings.append(f"{name}.transmissionTexture is not read; the material is drawn without transmission")
            return material
        alpha = material.base_color[3] if material.alpha_mode is AlphaMode.BLEND else 1.0
        alpha *= 1.0 - passed * (1.0 - 2.0 * _DIELECTRIC_REFLECTANCE)
        return replace(material, base_color=(*material.base_color[:3], alpha), alpha_mode=AlphaMode.BLEND)

    def _with_glossiness(self, material: Material, source: schema.SpecularGlossiness, name: str) -> Material:
        """Convert the archived specular-glossiness model to a dielectric of the same reflectance.

        The alpha channel of the texture, which holds the glossiness of each texel, is not read.
        """
        r, g, b = self._vector(source.specular_factor, f"{name}.specularFactor", (1.0, 1.0, 1.0))
        reflectance = _DIELECTRIC_REFLECTANCE
        return replace(
            material,
            base_color=self._vector(source.diffuse_factor, f"{name}.diffuseFactor", _WHITE),
            base_color_texture=self._textures.get(source.diffuse_texture, f"{name}.diffuseTexture"),
            metallic=0.0,
            roughness=1.0 - self._factor(source.glossiness_factor, f"{name}.glossinessFactor"),
            metallic_roughness_texture=None,
            specular_color=(r / reflectance, g / reflectance, b / reflectance),
            specular_color_texture=self._textures.get(
                source.specular_glossiness_texture, f"{name}.specularGlossinessTexture"
            ),
        )


def _variant_index(document: schema.Document, name: str, warnings: list[str]) -> int | None:
    """Return the index of a variant; None and a warning if the document has none of this name."""
    found = extension(document.extensions, _VARIANTS, schema.Variants, "", warnings)
    variants = (found and found.variants) or ()
    names = [variant.name if isinstance(variant, schema.Variant) else None for variant in variants]
    if name in names:
        return names.index(name)
    listed = ", ".join(repr(each)[:60] for each in names[:20]) or "none"
    warnings.append(f"the file has no material variant {name!r:.60} (it has {listed}), the default materials are drawn")
    return None


def multiplied(material: Material, color: tuple[float, ...]) -> Material:
    """Return a material whose base colour is multiplied by a linear RGBA colour."""
    r, g, b, a = (factor * own for factor, own in zip(color, material.base_color, strict=True))
    fallback = material.fallback and multiplied(material.fallback, color)
    return replace(material, base_color=(r, g, b, a), fallback=fallback)


def missing_coordinates(material: Material, mesh: Mesh) -> list[str]:
    """Return the attributes with texture coordinates that a material's textures need and a mesh lacks."""
    textures = [getattr(material, each.name) for each in fields(material)]
    sets = {texture.uv_set for texture in textures if isinstance(texture, Texture)}
    return [f"TEXCOORD_{number}" for number in sorted(sets) if (mesh.uv0, mesh.uv1)[number] is None]


def resembles_drake(primitive: schema.GltfPrimitive, materials: Sequence[object]) -> bool:
    """Return True if VTK's exporter writes such attributes and such a material for Drake's client."""
    index = primitive.material
    if index is None or not _NEVER_FROM_VTK.isdisjoint(primitive.attributes or ()):
        return False
    source = materials[index] if 0 <= index < len(materials) else None
    return isinstance(source, schema.GltfMaterial) and _looks_written_by_vtk(source)


def _looks_written_by_vtk(source: schema.GltfMaterial) -> bool:
    """Return True for a material with exactly the properties that VTK's exporter writes.

    These are ``{pbrMetallicRoughness: {baseColorFactor, [baseColorTexture], metallicFactor: 0, roughnessFactor: 1}}``.
    """
    pbr = source.pbr_metallic_roughness
    if pbr is None or pbr.base_color_factor is None or source != schema.GltfMaterial(pbr_metallic_roughness=pbr):
        return False
    color, texture = pbr.base_color_factor, pbr.base_color_texture
    return pbr == schema.MetallicRoughness(color, texture, metallic_factor=0.0, roughness_factor=1.0)


def _or_default(value: float | None, default: float) -> float:
    return default if value is None else float(value)


def _ior(value: float | None) -> float:
    """Return an index of refraction, at least 1. The value 0 is kept: KHR_materials_ior gives it a special meaning."""
    ior = _or_default(value, 1.5)
    return ior if ior == 0.0 else max(1.0, ior)
