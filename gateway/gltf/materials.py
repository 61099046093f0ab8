"""Materials of a document."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final, TypeVar

import msgspec

from gateway.gltf import document as gltf
from gateway.gltf.buffers import Buffers
from gateway.gltf.document import Document, extension, vector
from gateway.gltf.errors import GltfError, element
from gateway.gltf.limits import GltfLimits
from gateway.gltf.scene import DRAKE_GENERATORS
from gateway.gltf.textures import Textures
from renderers.drawlist import LABEL_NONE, AlphaMode, Material
from renderers.stop import check_stop

DEFAULT_MATERIAL: Final = Material(metallic=0.0)
"""Of primitives without one: white and, as RenderEngineVtk shows it, no metal. Compare by ``is``."""

_NOT_FROM_VTK: Final = frozenset({"NORMAL", "COLOR_0"})
"""Attributes that VTK's exporter leaves out of what Drake sends: only POSITION and TEXCOORD_0 were ever seen."""
_PBR: Final = gltf.MetallicRoughness()
_WHITE: Final = (1.0, 1.0, 1.0, 1.0)
_ALPHA_MODES: Final[dict[str | None, AlphaMode]] = {None: AlphaMode.OPAQUE} | {mode.value: mode for mode in AlphaMode}
_GLOSSINESS: Final = "KHR_materials_pbrSpecularGlossiness"
_REFLECTANCE: Final = 0.04
"""Of a dielectric with the default index of refraction, seen from the front."""

_E = TypeVar("_E", bound=msgspec.Struct)


def label_from_material(material: Material) -> int:
    """The label that a label request of Drake's client carries in a material, red in the low byte.

    The client sends each label as a linear colour of 8-bit steps, ``[r / 255, g / 255, b / 255, 1]``. A primitive
    without material carries no label.
    """
    if material is DEFAULT_MATERIAL:
        return LABEL_NONE
    return _label(material.base_color)


@lru_cache(maxsize=4096)
def _label(color: tuple[float, float, float, float]) -> int:
    red, green, blue = (round(255.0 * min(1.0, max(0.0, factor))) for factor in color[:3])
    return red | green << 8 | blue << 16


class Materials:
    """Makes the materials of one document, each when first used."""

    def __init__(
        self, document: Document, buffers: Buffers, limits: GltfLimits, warnings: list[str], *, textures: bool = True
    ) -> None:
        """``textures``: False leaves them out, images are not even looked at."""
        self._sources = document.materials or []
        self._texture = Textures(document, buffers, limits, warnings, wanted=textures).of
        generator = document.asset.generator if document.asset is not None else None
        self._from_drake = generator in DRAKE_GENERATORS
        self._materials: dict[int, Material] = {}
        self._vtk_materials: dict[int, Material] = {}
        """Of primitives that VTK's exporter may have written."""

    def of(self, primitive: gltf.Primitive, index: int, number: int) -> Material:
        """The material of ``meshes[index].primitives[number]``, or ``DEFAULT_MATERIAL``.

        Other exporters' materials may look like VTK's, but VTK's never writes normals or vertex colours.

        Raises:
            GltfError: out of range, a factor that is no vector, or images beyond the limits.
        """
        at = primitive.material
        if at is None:
            return DEFAULT_MATERIAL
        vtk = self._from_drake and (primitive.attributes is None or _NOT_FROM_VTK.isdisjoint(primitive.attributes))
        materials = self._vtk_materials if vtk else self._materials
        known = materials.get(at)
        if known is None:
            check_stop()
            sources = self._sources
            source = sources[at] if 0 <= at < len(sources) else None
            if source is None:
                source = element(sources, at, "materials", f"meshes[{index}].primitives[{number}].material")
            known = materials[at] = self._make(source, at, vtk)
        return known

    def _make(self, source: gltf.Material, at: int, vtk: bool) -> Material:
        """``materials[at]``; ``vtk``: VTK's exporter may have written it."""
        pbr = source.pbr_metallic_roughness or _PBR
        base_color = _vector(pbr.base_color_factor, _WHITE, at, "pbrMetallicRoughness.baseColorFactor")
        color, rough = pbr.base_color_texture, pbr.metallic_roughness_texture
        vtk = vtk and _is_vtk(source)
        if vtk and color is None:
            return _vtk_material(base_color)
        alpha_mode = AlphaMode.BLEND if vtk and base_color[3] < 1.0 else _alpha_mode(source.alpha_mode, at)
        metallic = _unit(pbr.metallic_factor, at, "metallicFactor")
        roughness = _unit(pbr.roughness_factor, at, "roughnessFactor")
        emissive = _vector(source.emissive_factor, (0.0, 0.0, 0.0), at, "emissiveFactor")
        cutoff = _number(source.alpha_cutoff, 0.5, at, "alphaCutoff")
        double_sided = bool(source.double_sided) or vtk
        normal, occlusion = source.normal_texture, source.occlusion_texture
        bare = normal is None and occlusion is None and source.emissive_texture is None and rough is None
        if bare and color is None and not source.extensions:
            return _untextured(base_color, metallic, roughness, emissive, alpha_mode, cutoff, double_sided)
        of_color = self._texture(color, at, "baseColorTexture")
        if bare and not source.extensions:
            return Material(
                base_color,
                of_color,
                metallic,
                roughness,
                emissive=emissive,
                alpha_mode=alpha_mode,
                alpha_cutoff=cutoff,
                double_sided=double_sided,
                vtk_export=vtk,
            )
        made = Material(
            base_color=base_color,
            base_color_texture=of_color,
            metallic=metallic,
            roughness=roughness,
            metallic_roughness_texture=self._texture(rough, at, "metallicRoughnessTexture"),
            normal_texture=self._texture(normal, at, "normalTexture"),
            normal_scale=_number(normal.scale if normal else None, 1.0, at, "normalTexture.scale"),
            occlusion_texture=self._texture(occlusion, at, "occlusionTexture"),
            occlusion_strength=_unit(occlusion.strength if occlusion else None, at, "occlusionTexture.strength"),
            emissive=emissive,
            emissive_texture=self._texture(source.emissive_texture, at, "emissiveTexture"),
            alpha_mode=alpha_mode,
            alpha_cutoff=cutoff,
            double_sided=double_sided,
            vtk_export=vtk,
        )
        return self._extended(made, source, at) if source.extensions else made

    def _extended(self, made: Material, source: gltf.Material, at: int) -> Material:
        """With what the extensions of the material say."""
        strength = _extension(source, "KHR_materials_emissive_strength", gltf.EmissiveStrength, at)
        ior = _extension(source, "KHR_materials_ior", gltf.Ior, at)
        specular = _extension(source, "KHR_materials_specular", gltf.Specular, at)
        made = replace(
            made,
            emissive_strength=max(0.0, _number(strength.emissive_strength, 1.0, at, "emissiveStrength")),
            unlit=extension(source.extensions, "KHR_materials_unlit") is not None,
            ior=_ior(ior.ior, at),
            specular=_unit(specular.specular_factor, at, "specularFactor"),
            specular_texture=self._texture(specular.specular_texture, at, "specularTexture"),
            specular_color=_vector(specular.specular_color_factor, (1.0, 1.0, 1.0), at, "specularColorFactor"),
            specular_color_texture=self._texture(specular.specular_color_texture, at, "specularColorTexture"),
        )
        if extension(source.extensions, _GLOSSINESS) is None:
            return made
        return self._glossy(made, _extension(source, _GLOSSINESS, gltf.SpecularGlossiness, at), at)

    def _glossy(self, made: Material, glossy: gltf.SpecularGlossiness, at: int) -> Material:
        """A material of the archived specular-glossiness model as a dielectric of the same reflectance; the glossiness
        in its texture's alpha is not read."""
        r, g, b = _vector(glossy.specular_factor, (1.0, 1.0, 1.0), at, "specularFactor")
        return replace(
            made,
            base_color=_vector(glossy.diffuse_factor, _WHITE, at, "diffuseFactor"),
            base_color_texture=self._texture(glossy.diffuse_texture, at, "diffuseTexture"),
            metallic=0.0,
            roughness=1.0 - _unit(glossy.glossiness_factor, at, "glossinessFactor"),
            metallic_roughness_texture=None,
            specular_color=(r / _REFLECTANCE, g / _REFLECTANCE, b / _REFLECTANCE),
            specular_color_texture=self._texture(glossy.specular_glossiness_texture, at, "specularGlossinessTexture"),
        )


@lru_cache(maxsize=1024)
def _vtk_material(color: tuple[float, float, float, float]) -> Material:
    """What nearly all materials of VTK's exporter are: a colour; equal ones are one object."""
    blended = AlphaMode.BLEND if color[3] < 1.0 else AlphaMode.OPAQUE
    return Material(
        base_color=color, metallic=0.0, roughness=1.0, alpha_mode=blended, double_sided=True, vtk_export=True
    )


@lru_cache(maxsize=1024)
def _untextured(
    color: tuple[float, float, float, float],
    metallic: float,
    roughness: float,
    emissive: tuple[float, float, float],
    alpha_mode: AlphaMode,
    cutoff: float,
    double_sided: bool,
) -> Material:
    """What most others are: a few numbers; equal ones are one object."""
    return Material(
        base_color=color,
        metallic=metallic,
        roughness=roughness,
        emissive=emissive,
        alpha_mode=alpha_mode,
        alpha_cutoff=cutoff,
        double_sided=double_sided,
    )


def _is_vtk(source: gltf.Material) -> bool:
    """Whether it has exactly the shape that VTK's exporter writes.

    That is ``{pbrMetallicRoughness: {baseColorFactor, [baseColorTexture], metallicFactor: 0, roughnessFactor: 1}}``.
    """
    pbr = source.pbr_metallic_roughness
    if pbr is None or pbr.base_color_factor is None or source != gltf.Material(pbr_metallic_roughness=pbr):
        return False
    color, texture = pbr.base_color_factor, pbr.base_color_texture
    return pbr == gltf.MetallicRoughness(color, texture, metallic_factor=0.0, roughness_factor=1.0)


def _extension(source: gltf.Material, extension_name: str, kind: type[_E], at: int) -> _E:
    """A material's extension, all fields null where it is absent."""
    raw = extension(source.extensions, extension_name)
    if raw is None:
        return kind()
    try:
        return msgspec.json.decode(raw, type=kind)
    except msgspec.MsgspecError as error:
        raise GltfError(f"materials[{at}].extensions.{extension_name}: {error}") from error


# Of a member of materials[at], checked; text is made of these only for a message.


def _alpha_mode(value: str | None, at: int) -> AlphaMode:
    mode = _ALPHA_MODES.get(value)
    if mode is None:
        raise GltfError(f"materials[{at}].alphaMode: {value!r:.30} is not OPAQUE, MASK or BLEND")
    return mode


def _vector(values: list[float] | None, default: tuple[float, ...], at: int, member: str) -> tuple[Any, ...]:
    if values is None:
        return default
    if len(values) == len(default) and math.isfinite(sum(values)):
        return tuple(values)
    return vector(values, default, f"materials[{at}].{member}")


def _number(value: float | None, default: float, at: int, member: str) -> float:
    if value is None:
        return default
    if not math.isfinite(value):
        raise GltfError(f"materials[{at}].{member}: not finite")
    return float(value)


def _unit(value: float | None, at: int, member: str) -> float:
    if value is None or 0.0 < value <= 1.0:
        return 1.0 if value is None else value
    return min(1.0, max(0.0, _number(value, 1.0, at, member)))


def _ior(value: float | None, at: int) -> float:
    """At least 1, but 0 has a meaning of its own (KHR_materials_ior)."""
    number = _number(value, 1.5, at, "ior")
    return number if number == 0.0 else max(1.0, number)
