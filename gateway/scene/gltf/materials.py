"""Materials, textures, samplers and images of a document."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final, TypeVar

import msgspec

from gateway.scene.gltf import document as gltf
from gateway.scene.gltf.buffers import Buffers
from gateway.scene.gltf.document import Document, extension, vector
from gateway.scene.gltf.errors import GltfError, element
from gateway.scene.gltf.limits import GltfLimits
from gateway.scene.gltf.scene import DRAKE_GENERATORS
from renderers.drawlist import LABEL_NONE, AlphaMode, Image, ImageError, Material, Sampler, Texture, Wrap
from renderers.images import image_from_bytes, image_header

DEFAULT_MATERIAL: Final = Material(metallic=0.0)
"""Of primitives without one: white and, as RenderEngineVtk shows it, no metal. Compare by ``is``."""

_NOT_FROM_VTK: Final = frozenset({"NORMAL", "COLOR_0"})
"""Attributes that VTK's exporter leaves out of what Drake sends: only POSITION and TEXCOORD_0 were ever seen."""
_NEAREST: Final = 9728
_MIN_NEAREST: Final = frozenset({9728, 9984, 9986})
_MIN_MIPMAPS: Final = frozenset({9984, 9985, 9986, 9987})
_MIP_NEAREST: Final = frozenset({9984, 9985})
_PBR: Final = gltf.MetallicRoughness()
_WHITE: Final = (1.0, 1.0, 1.0, 1.0)
_SAMPLER: Final = Sampler()
_WRAPS: Final[dict[int | None, Wrap]] = {None: Wrap.REPEAT} | {wrap.value: wrap for wrap in Wrap}
_ALPHA_MODES: Final[dict[str | None, AlphaMode]] = {None: AlphaMode.OPAQUE} | {mode.value: mode for mode in AlphaMode}
_GLOSSINESS: Final = "KHR_materials_pbrSpecularGlossiness"
_IMAGES_OF_BUFFER: Final = 4096
"""Images that a buffer remembers. Documents can ask for ever new pieces of one that is kept; then all are forgotten."""
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
        self._document = document
        self._buffers = buffers
        self._limits = limits
        self._warnings = warnings
        self._with_textures = textures
        generator = document.asset.generator if document.asset is not None else None
        self._from_drake = generator in DRAKE_GENERATORS
        self._materials: dict[int, Material] = {}
        self._vtk_materials: dict[int, Material] = {}
        """Of primitives that VTK's exporter may have written."""
        self._textures: dict[int, Texture | None] = {}
        """With the first texture coordinates, as they are."""
        self._images: dict[int, Image] = {}
        self._counted: set[int] = set()
        """Identities of images, which are held."""
        self._pixels = 0

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
            sources = self._document.materials or ()
            source = sources[at] if 0 <= at < len(sources) else None
            if source is None:
                where = f"meshes[{index}].primitives[{number}].material"
                source = element(self._document.materials, at, "materials", where)
            known = materials[at] = self._make(source, f"materials[{at}]", vtk)
        return known

    def _make(self, source: gltf.Material, name: str, vtk: bool) -> Material:
        pbr = source.pbr_metallic_roughness or _PBR
        base_color = _vector(pbr.base_color_factor, _WHITE, name, "pbrMetallicRoughness.baseColorFactor")
        normal, occlusion = source.normal_texture, source.occlusion_texture
        vtk = vtk and _is_vtk(source)
        if vtk and pbr.base_color_texture is None:
            return _vtk_material(base_color)
        alpha_mode = _alpha_mode(source.alpha_mode, name)
        if vtk and base_color[3] < 1.0:
            alpha_mode = AlphaMode.BLEND
        metallic = _unit(pbr.metallic_factor, name, "metallicFactor")
        roughness = _unit(pbr.roughness_factor, name, "roughnessFactor")
        emissive = _vector(source.emissive_factor, (0.0, 0.0, 0.0), name, "emissiveFactor")
        cutoff = _number(source.alpha_cutoff, 0.5, name, "alphaCutoff")
        double_sided = bool(source.double_sided) or vtk
        color, rough = pbr.base_color_texture, pbr.metallic_roughness_texture
        bare = normal is None and occlusion is None and source.emissive_texture is None and rough is None
        if bare and color is None and not source.extensions:
            return _untextured(base_color, metallic, roughness, emissive, alpha_mode, cutoff, double_sided)
        of_color = None if color is None else self._texture(color, name, "baseColorTexture")
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
            metallic_roughness_texture=self._texture(rough, name, "metallicRoughnessTexture"),
            normal_texture=self._texture(normal, name, "normalTexture"),
            normal_scale=_number(normal.scale if normal else None, 1.0, name, "normalTexture.scale"),
            occlusion_texture=self._texture(occlusion, name, "occlusionTexture"),
            occlusion_strength=_unit(occlusion.strength if occlusion else None, name, "occlusionTexture.strength"),
            emissive=emissive,
            emissive_texture=self._texture(source.emissive_texture, name, "emissiveTexture"),
            alpha_mode=alpha_mode,
            alpha_cutoff=cutoff,
            double_sided=double_sided,
            vtk_export=vtk,
        )
        return self._extended(made, source, name) if source.extensions else made

    def _extended(self, made: Material, source: gltf.Material, name: str) -> Material:
        """With what the extensions of the material say."""
        strength = self._extension(source, "KHR_materials_emissive_strength", gltf.EmissiveStrength, name)
        ior = self._extension(source, "KHR_materials_ior", gltf.Ior, name)
        specular = self._extension(source, "KHR_materials_specular", gltf.Specular, name)
        made = replace(
            made,
            emissive_strength=max(0.0, _number(strength.emissive_strength, 1.0, name, "emissiveStrength")),
            unlit=extension(source.extensions, "KHR_materials_unlit") is not None,
            ior=_ior(ior.ior, name),
            specular=_unit(specular.specular_factor, name, "specularFactor"),
            specular_texture=self._texture(specular.specular_texture, name, "specularTexture"),
            specular_color=vector(specular.specular_color_factor, (1.0, 1.0, 1.0), f"{name}.specularColorFactor"),
            specular_color_texture=self._texture(specular.specular_color_texture, name, "specularColorTexture"),
        )
        if extension(source.extensions, _GLOSSINESS) is None:
            return made
        return self._glossy(made, self._extension(source, _GLOSSINESS, gltf.SpecularGlossiness, name), name)

    def _glossy(self, made: Material, glossy: gltf.SpecularGlossiness, name: str) -> Material:
        """A material of the archived specular-glossiness model as a dielectric of the same reflectance; the glossiness
        in its texture's alpha is not read."""
        r, g, b = vector(glossy.specular_factor, (1.0, 1.0, 1.0), f"{name}.specularFactor")
        return replace(
            made,
            base_color=vector(glossy.diffuse_factor, (1.0, 1.0, 1.0, 1.0), f"{name}.diffuseFactor"),
            base_color_texture=self._texture(glossy.diffuse_texture, name, "diffuseTexture"),
            metallic=0.0,
            roughness=1.0 - _unit(glossy.glossiness_factor, name, "glossinessFactor"),
            metallic_roughness_texture=None,
            specular_color=(r / _REFLECTANCE, g / _REFLECTANCE, b / _REFLECTANCE),
            specular_color_texture=self._texture(glossy.specular_glossiness_texture, name, "specularGlossinessTexture"),
        )

    def _extension(self, source: gltf.Material, extension_name: str, kind: type[_E], name: str) -> _E:
        """A material's extension, all fields null where it is absent."""
        raw = extension(source.extensions, extension_name)
        if raw is None:
            return kind()
        try:
            return msgspec.json.decode(raw, type=kind)
        except msgspec.MsgspecError as error:
            raise GltfError(f"{name}.extensions.{extension_name}: {error}") from error

    def _texture(self, info: gltf.TextureInfo | None, name: str, member: str) -> Texture | None:
        if info is None or not self._with_textures:
            return None
        index = info.index
        if index is None:
            raise GltfError(f"{name}.{member}.index: missing")
        textures = self._textures
        loaded = textures[index] if index in textures else self._load(index, name, member)
        if loaded is None or (not info.tex_coord and not info.extensions):
            return loaded
        uv_set, uv_transform = info.tex_coord or 0, None
        raw = extension(info.extensions, "KHR_texture_transform")
        if raw is not None:
            where = f"{name}.{member}.extensions.KHR_texture_transform"
            try:
                transform = msgspec.json.decode(raw, type=gltf.TextureTransform)
            except msgspec.MsgspecError as error:
                raise GltfError(f"{where}: {error}") from error
            uv_transform = _uv_transform(transform, where)
            uv_set = uv_set if transform.tex_coord is None else transform.tex_coord
        if uv_set not in (0, 1):
            self._warnings.append(f"{name}.{member}: TEXCOORD_{uv_set} is not read, TEXCOORD_0 is used")
            uv_set = 0
        return Texture(loaded.image, loaded.sampler, uv_set, uv_transform)

    def _load(self, index: int, name: str, member: str) -> Texture | None:
        sources = self._document.textures or ()
        texture = sources[index] if 0 <= index < len(sources) else None
        if texture is None:
            texture = element(self._document.textures, index, "textures", f"{name}.{member}.index")
        image = texture.source
        if image is not None:
            made: Texture | None = Texture(self._image(image, index), self._sampler(texture.sampler, index))
        else:
            made = self._webp(texture, index)
        self._textures[index] = made
        return made

    def _webp(self, texture: gltf.Texture, index: int) -> Texture | None:
        """Of a texture without a source."""
        name = f"textures[{index}]"
        raw = extension(texture.extensions, "EXT_texture_webp")
        # Drake's merge leaves the indices in extensions as they were in the single files.
        if raw is not None and not self._from_drake:
            try:
                webp = msgspec.json.decode(raw, type=gltf.ImageSource)
            except msgspec.MsgspecError as error:
                raise GltfError(f"{name}.extensions.EXT_texture_webp: {error}") from error
            if webp.source is not None:
                image = self._image(webp.source, index, ".extensions.EXT_texture_webp")
                return Texture(image, self._sampler(texture.sampler, index))
        offered = ", ".join(texture.extensions or ()) or "no extension"
        self._warnings.append(f"{name}: no source ({offered}), so there is no texture")
        return None

    def _sampler(self, index: int | None, texture: int) -> Sampler:
        if index is None:
            return _SAMPLER
        sources = self._document.samplers or ()
        source = sources[index] if 0 <= index < len(sources) else None
        if source is None:
            source = element(self._document.samplers, index, "samplers", f"textures[{texture}].sampler")
        s, t = _WRAPS.get(source.wrap_s), _WRAPS.get(source.wrap_t)
        if s is None:
            s = self._repeating(source.wrap_s, f"samplers[{index}].wrapS")
        if t is None:
            t = self._repeating(source.wrap_t, f"samplers[{index}].wrapT")
        return _sampler_of(s, t, source.mag_filter, source.min_filter)

    def _repeating(self, value: int | None, where: str) -> Wrap:
        self._warnings.append(f"{where}: {value} is not a wrap mode, REPEAT is used")
        return Wrap.REPEAT

    def _image(self, index: int, texture: int, part: str = "") -> Image:
        known = self._images.get(index)
        if known is not None:
            return known
        sources = self._document.images or ()
        source = sources[index] if 0 <= index < len(sources) else None
        if source is None:
            source = element(self._document.images, index, "images", f"textures[{texture}]{part}.source")
        name = f"images[{index}] ({source.name[:60]})" if source.name else f"images[{index}]"
        if source.buffer_view is not None:
            buffer, offset, length, _ = self._buffers.view(source.buffer_view, f"images[{index}].bufferView")
        elif source.uri is not None:
            buffer = self._buffers.of_uri(source.uri, "images", index)
            offset, length = 0, len(buffer.data)
        else:
            raise GltfError(f"images[{index}]: there is neither a uri nor a bufferView")
        image = buffer.images.get((offset, length))
        data = memoryview(buffer.data)[offset : offset + length]
        if image is None:
            self._buffers.charge(length, f"images[{index}]")  # it is hashed: many views can name the same bytes
            image = image_from_bytes(data, name=name, max_pixels=self._limits.max_image_pixels)
            if len(buffer.images) >= _IMAGES_OF_BUFFER:
                buffer.images.clear()
            buffer.images[offset, length] = image
        self._images[index] = image
        self._count_pixels(image, data, name)
        return image

    def _count_pixels(self, image: Image, data: memoryview, name: str) -> None:
        if id(image) in self._counted:
            return
        self._counted.add(id(image))
        try:
            pixels = image_header(data, name).pixels
        except ImageError as error:
            # Depth and label pictures do not need it: only who decodes it gets the error.
            self._warnings.append(str(error))
            pixels = 0
        self._pixels += pixels
        if pixels > self._limits.max_image_pixels:
            raise GltfError(f"{name}: {pixels} pixels are more than max_image_pixels = {self._limits.max_image_pixels}")
        if self._pixels > self._limits.max_total_image_pixels:
            limit = self._limits.max_total_image_pixels
            raise GltfError(f"{name}: the images have more pixels than max_total_image_pixels = {limit}")


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


@lru_cache(maxsize=256)
def _sampler_of(wrap_s: Wrap, wrap_t: Wrap, largest: int | None, smallest: int | None) -> Sampler:
    """``largest`` and ``smallest``: glTF's magFilter and minFilter."""
    return Sampler(
        wrap_s=wrap_s,
        wrap_t=wrap_t,
        mag_linear=largest != _NEAREST,
        min_linear=smallest not in _MIN_NEAREST,
        mipmaps=smallest is None or smallest in _MIN_MIPMAPS,
        mip_linear=smallest not in _MIP_NEAREST,
    )


def _is_vtk(source: gltf.Material) -> bool:
    """Whether it has exactly the shape that VTK's exporter writes.

    That is ``{pbrMetallicRoughness: {baseColorFactor, [baseColorTexture], metallicFactor: 0, roughnessFactor: 1}}``.
    """
    pbr = source.pbr_metallic_roughness
    if pbr is None or pbr.base_color_factor is None or len(pbr.base_color_factor) != 4:
        return False
    return (
        pbr.metallic_factor == 0.0
        and pbr.roughness_factor == 1.0
        and pbr.metallic_roughness_texture is None
        and source.name is None
        and source.double_sided is None
        and source.alpha_mode is None
        and source.alpha_cutoff is None
        and source.extensions is None
        and source.normal_texture is None
        and source.occlusion_texture is None
        and source.emissive_texture is None
        and source.emissive_factor is None
    )


def _alpha_mode(value: str | None, name: str) -> AlphaMode:
    mode = _ALPHA_MODES.get(value)
    if mode is None:
        raise GltfError(f"{name}.alphaMode: {value!r:.30} is not OPAQUE, MASK or BLEND")
    return mode


def _vector(values: list[float] | None, default: tuple[float, ...], name: str, member: str) -> tuple[Any, ...]:
    return default if values is None else vector(values, default, f"{name}.{member}")


def _number(value: float | None, default: float, name: str, member: str) -> float:
    if value is None:
        return default
    if not math.isfinite(value):
        raise GltfError(f"{name}.{member}: not finite")
    return float(value)


def _unit(value: float | None, name: str, member: str) -> float:
    return min(1.0, max(0.0, _number(value, 1.0, name, member)))


def _ior(value: float | None, name: str) -> float:
    """At least 1, but 0 has a meaning of its own (KHR_materials_ior)."""
    number = _number(value, 1.5, name, "ior")
    return number if number == 0.0 else max(1.0, number)


def _uv_transform(source: gltf.TextureTransform, where: str) -> tuple[float, float, float, float, float, float]:
    """Offset * rotation * scale, as the extension's text and reference viewer compose them; v points down."""
    x, y = vector(source.offset, (0.0, 0.0), f"{where}.offset")
    sx, sy = vector(source.scale, (1.0, 1.0), f"{where}.scale")
    angle = _number(source.rotation, 0.0, where, "rotation")
    c, s = math.cos(angle), math.sin(angle)
    return (c * sx, s * sy, x, -s * sx, c * sy, y)
