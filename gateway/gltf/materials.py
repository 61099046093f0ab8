"""Materials of a document, and the labels that Drake's client encodes in them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, TypeVar

import msgspec

from gateway.gltf import schema
from gateway.gltf.errors import GltfError, GltfLimitError, checked_item
from gateway.gltf.parser import extension_json, finite_vector_or_default
from gateway.gltf.textures import Textures
from renderers.drawlist import LABEL_NONE, AlphaMode, Material
from renderers.stop import check_stop

DEFAULT_MATERIAL: Final = Material(metallic=0.0, fallback=Material(metallic=0.0, roughness=0.5, double_sided=True))
"""Material of primitives without one: white and not metallic, as RenderEngineVtk shows it. Compare by ``is``."""

_NEVER_FROM_VTK: Final = frozenset({"NORMAL", "COLOR_0"})
"""Attributes that VTK's exporter never writes in documents from Drake (only POSITION and TEXCOORD_0)."""
_WHITE: Final = (1.0, 1.0, 1.0, 1.0)
_ALPHA_MODES: Final[dict[str | None, AlphaMode]] = {None: AlphaMode.OPAQUE} | {mode.value: mode for mode in AlphaMode}
_GLOSSINESS: Final = "KHR_materials_pbrSpecularGlossiness"
_TRANSMISSION: Final = "KHR_materials_transmission"
_DIELECTRIC_REFLECTANCE: Final = 0.04
"""Reflectance at normal incidence for an index of refraction of 1.5."""

_VARIANTS: Final = "KHR_materials_variants"

_Extension = TypeVar("_Extension", bound=msgspec.Struct)


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
        self, document: schema.Document, textures: Textures, warnings: list[str], variant: str | None = None
    ) -> None:
        """
        Args:
            variant: Name of a variant of KHR_materials_variants; None: the default materials.
        """
        self._sources = document.materials
        self._warnings = warnings
        self._variant = None if variant is None else _variant_index(document, variant, warnings)
        self._textures = textures
        self._from_drake = document.from_drake
        self._decodes_vertex_colors = not document.from_old_drake
        self._materials: dict[tuple[int, bool], Material] = {}
        """By index in the document, and True if VTK's exporter wrote the primitive."""
        self._written_by_vtk: dict[int, bool] = {}
        """By index in the document."""

    def get(self, primitive: schema.Primitive, name: str) -> Material:
        """Return the material of a primitive; ``DEFAULT_MATERIAL`` if it has none, or one that cannot be read.

        Args:
            name: ``meshes[2].primitives[0]``, for messages.

        Raises:
            GltfLimitError: Images are beyond the limits.
        """
        try:
            return self._find(primitive, name)
        except GltfLimitError:
            raise
        except GltfError as error:
            self._warnings.append(f"{error}; {name} has the default material")
            return DEFAULT_MATERIAL

    def _find(self, primitive: schema.Primitive, name: str) -> Material:
        """Return the material of a primitive, or ``DEFAULT_MATERIAL``. Raises GltfError."""
        index = self._index(primitive, name)
        if index is None:
            return DEFAULT_MATERIAL
        vtk = self.is_from_vtk(primitive)
        material = self._materials.get((index, vtk))
        if material is None:
            check_stop()
            source = checked_item(self._sources, index, "materials", f"{name}.material")
            material = self._materials[index, vtk] = self._read(source, f"materials[{index}]", vtk=vtk)
        return material

    def _index(self, primitive: schema.Primitive, name: str) -> int | None:
        """Return the index of a primitive's material in the variant, or else its default; None if it has neither."""
        raw = None if self._variant is None else extension_json(primitive.extensions, _VARIANTS)
        if raw is None:
            return primitive.material
        try:
            mappings = msgspec.json.decode(raw, type=schema.VariantMappings).mappings or []
        except msgspec.MsgspecError as error:
            raise GltfError(f"{name}.extensions.{_VARIANTS}: {error}") from error
        chosen = [each.material for each in mappings if each is not None and self._variant in (each.variants or ())]
        return chosen[0] if chosen else primitive.material

    def is_from_vtk(self, primitive: schema.Primitive) -> bool:
        """Return True for a primitive that VTK's exporter wrote for Drake's client.

        Other exporters may write the same material, but VTK's never writes normals or vertex colours.
        """
        index, sources = primitive.material, self._sources or []
        if index is None or not self._from_drake or not _NEVER_FROM_VTK.isdisjoint(primitive.attributes or ()):
            return False
        is_from_vtk = self._written_by_vtk.get(index)
        if is_from_vtk is None:
            source = sources[index] if 0 <= index < len(sources) else None
            is_from_vtk = self._written_by_vtk[index] = source is not None and _looks_written_by_vtk(source)
        return is_from_vtk

    def _read(self, source: schema.Material, name: str, *, vtk: bool) -> Material:
        """Read a material.

        Args:
            name: ``materials[3]``, for messages.
            vtk: True for a material of VTK's exporter, which writes neither ``alphaMode`` nor ``doubleSided``.
        """
        pbr = source.pbr_metallic_roughness or schema.MetallicRoughness()
        base_color = finite_vector_or_default(
            pbr.base_color_factor, _WHITE, f"{name}.pbrMetallicRoughness.baseColorFactor"
        )
        normal, occlusion, read_texture = source.normal_texture, source.occlusion_texture, self._textures.get
        material = Material(
            base_color=base_color,
            base_color_texture=read_texture(pbr.base_color_texture, f"{name}.baseColorTexture"),
            metallic=_factor(pbr.metallic_factor, f"{name}.metallicFactor"),
            roughness=_factor(pbr.roughness_factor, f"{name}.roughnessFactor"),
            metallic_roughness_texture=read_texture(pbr.metallic_roughness_texture, f"{name}.metallicRoughnessTexture"),
            normal_texture=read_texture(normal, f"{name}.normalTexture"),
            normal_scale=_finite_or_default(normal.scale if normal else None, 1.0, f"{name}.normalTexture.scale"),
            occlusion_texture=read_texture(occlusion, f"{name}.occlusionTexture"),
            occlusion_strength=_factor(occlusion.strength if occlusion else None, f"{name}.occlusionTexture.strength"),
            emissive=finite_vector_or_default(source.emissive_factor, (0.0, 0.0, 0.0), f"{name}.emissiveFactor"),
            emissive_texture=read_texture(source.emissive_texture, f"{name}.emissiveTexture"),
            alpha_mode=AlphaMode.BLEND if vtk and base_color[3] < 1.0 else self._alpha_mode(source.alpha_mode, name),
            alpha_cutoff=_finite_or_default(source.alpha_cutoff, 0.5, f"{name}.alphaCutoff"),
            double_sided=bool(source.double_sided) or vtk,
            vtk_export=vtk,
            decodes_vertex_colors=self._decodes_vertex_colors,
        )
        return self._with_extensions(material, source, name) if source.extensions else material

    def _extension(self, source: schema.Material, extension: str, type_: type[_Extension], name: str) -> _Extension:
        """Return a material's extension as a ``type_``; all of its fields are None if it is absent or invalid."""
        raw = extension_json(source.extensions, extension)
        if raw is None:
            return type_()
        try:
            return msgspec.json.decode(raw, type=type_)
        except msgspec.MsgspecError as error:
            self._warnings.append(f"{name}.extensions.{extension}: {error}; it is ignored")
            return type_()

    def _alpha_mode(self, value: str | None, name: str) -> AlphaMode:
        mode = _ALPHA_MODES.get(value)
        if mode is None:
            self._warnings.append(f"{name}.alphaMode: {value!r:.30} is not OPAQUE, MASK or BLEND; OPAQUE is used")
        return mode or AlphaMode.OPAQUE

    def _with_extensions(self, material: Material, source: schema.Material, name: str) -> Material:
        strength = self._extension(source, "KHR_materials_emissive_strength", schema.EmissiveStrength, name)
        ior = self._extension(source, "KHR_materials_ior", schema.Ior, name)
        specular = self._extension(source, "KHR_materials_specular", schema.Specular, name)
        material = replace(
            material,
            emissive_strength=max(0.0, _finite_or_default(strength.emissive_strength, 1.0, f"{name}.emissiveStrength")),
            unlit=extension_json(source.extensions, "KHR_materials_unlit") is not None,
            ior=_ior(ior.ior, f"{name}.ior"),
            specular=_factor(specular.specular_factor, f"{name}.specularFactor"),
            specular_texture=self._textures.get(specular.specular_texture, f"{name}.specularTexture"),
            specular_color=finite_vector_or_default(
                specular.specular_color_factor, (1.0, 1.0, 1.0), f"{name}.specularColorFactor"
            ),
            specular_color_texture=self._textures.get(specular.specular_color_texture, f"{name}.specularColorTexture"),
        )
        read_by_vtk = material
        if extension_json(source.extensions, _GLOSSINESS) is not None:
            glossiness = self._extension(source, _GLOSSINESS, schema.SpecularGlossiness, name)
            material = self._with_glossiness(material, glossiness, name)
        transmission = self._extension(source, _TRANSMISSION, schema.Transmission, name)
        material = self._with_transmission(material, transmission, name)
        return material if material is read_by_vtk else replace(material, fallback=read_by_vtk)

    def _with_transmission(self, material: Material, source: schema.Transmission, name: str) -> Material:
        """Return a transparent material as a blended one.

        The light that passes is that of what is behind, times the transmission and the strongest channel of the base
        colour; both faces reflect a part, so that clear glass stays visible. It is neither refracted nor tinted.
        """
        factor = min(1.0, max(0.0, _finite_or_default(source.transmission_factor, 0.0, f"{name}.transmissionFactor")))
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
        r, g, b = finite_vector_or_default(source.specular_factor, (1.0, 1.0, 1.0), f"{name}.specularFactor")
        reflectance = _DIELECTRIC_REFLECTANCE
        return replace(
            material,
            base_color=finite_vector_or_default(source.diffuse_factor, _WHITE, f"{name}.diffuseFactor"),
            base_color_texture=self._textures.get(source.diffuse_texture, f"{name}.diffuseTexture"),
            metallic=0.0,
            roughness=1.0 - _factor(source.glossiness_factor, f"{name}.glossinessFactor"),
            metallic_roughness_texture=None,
            specular_color=(r / reflectance, g / reflectance, b / reflectance),
            specular_color_texture=self._textures.get(
                source.specular_glossiness_texture, f"{name}.specularGlossinessTexture"
            ),
        )


def _variant_index(document: schema.Document, name: str, warnings: list[str]) -> int | None:
    """Return the index of a variant; None and a warning if the document has none of this name."""
    raw = extension_json(document.extensions, _VARIANTS)
    try:
        variants = [] if raw is None else msgspec.json.decode(raw, type=schema.Variants).variants or []
    except msgspec.MsgspecError as error:
        raise GltfError(f"extensions.{_VARIANTS}: {error}") from error
    names = [variant.name if variant is not None else None for variant in variants]
    if name in names:
        return names.index(name)
    listed = ", ".join(repr(each)[:60] for each in names[:20]) or "none"
    warnings.append(f"the file has no material variant {name!r:.60} (it has {listed}), the default materials are drawn")
    return None


def _looks_written_by_vtk(source: schema.Material) -> bool:
    """Return True for a material with exactly the properties that VTK's exporter writes.

    These are ``{pbrMetallicRoughness: {baseColorFactor, [baseColorTexture], metallicFactor: 0, roughnessFactor: 1}}``.
    """
    pbr = source.pbr_metallic_roughness
    if pbr is None or pbr.base_color_factor is None or source != schema.Material(pbr_metallic_roughness=pbr):
        return False
    color, texture = pbr.base_color_factor, pbr.base_color_texture
    return pbr == schema.MetallicRoughness(color, texture, metallic_factor=0.0, roughness_factor=1.0)


def _finite_or_default(value: float | None, default: float, path: str) -> float:
    """Return a number from the document, or ``default`` for null; GltfError if it is not finite."""
    if value is None:
        return default
    if not math.isfinite(value):
        raise GltfError(f"{path}: not finite")
    return float(value)


def _factor(value: float | None, path: str) -> float:
    """Return a factor clamped to 0 .. 1; 1 if it is absent."""
    return min(1.0, max(0.0, _finite_or_default(value, 1.0, path)))


def _ior(value: float | None, path: str) -> float:
    """Return an index of refraction, at least 1. The value 0 is kept: KHR_materials_ior gives it a special meaning."""
    ior = _finite_or_default(value, 1.5, path)
    return ior if ior == 0.0 else max(1.0, ior)
