"""glTF's JSON as values: only what the reader uses, lenient about nulls, strict about types."""

from __future__ import annotations

import json
import math
from typing import Any, Final, TypeAlias

import msgspec

from gateway.gltf.errors import GltfError
from gateway.gltf.limits import GltfLimits
from renderers.stop import check_stop

Extensions: TypeAlias = dict[str, msgspec.Raw] | None
"""By name, not parsed."""


class _Object(msgspec.Struct, rename="camel", gc=False):
    """Every field may be absent or null: Drake's client writes ``"nodes": null`` for empty arrays.

    Fields are in the order of their names, as Drake's client and most exporters write them: msgspec looks for each from
    the last one on.
    """


class Asset(_Object):
    generator: str | None = None
    min_version: str | None = None
    version: str | None = None


class Scene(_Object):
    nodes: list[int | None] | None = None


class Node(_Object):
    camera: int | None = None
    children: list[int | None] | None = None
    extensions: Extensions = None
    matrix: list[float] | None = None
    mesh: int | None = None
    name: str | None = None
    rotation: list[float] | None = None
    scale: list[float] | None = None
    skin: int | None = None
    translation: list[float] | None = None
    weights: list[float] | None = None


class Primitive(_Object):
    attributes: dict[str, int | None] | None = None
    extensions: Extensions = None
    indices: int | None = None
    material: int | None = None
    mode: int | None = None


class Mesh(_Object):
    primitives: list[Primitive | None] | None = None
    weights: list[float] | None = None


class SparseIndices(_Object):
    buffer_view: int | None = None
    byte_offset: int | None = None
    component_type: int | None = None


class SparseValues(_Object):
    buffer_view: int | None = None
    byte_offset: int | None = None


class Sparse(_Object):
    count: int | None = None
    indices: SparseIndices | None = None
    values: SparseValues | None = None


class Accessor(_Object):
    buffer_view: int | None = None
    byte_offset: int | None = None
    component_type: int | None = None
    count: int | None = None
    normalized: bool | None = None
    sparse: Sparse | None = None
    type: str | None = None


class BufferView(_Object):
    buffer: int | None = None
    byte_length: int | None = None
    byte_offset: int | None = None
    byte_stride: int | None = None
    extensions: Extensions = None


class Buffer(_Object):
    byte_length: int | None = None
    uri: str | None = None


class Image(_Object):
    buffer_view: int | None = None
    name: str | None = None
    uri: str | None = None


class Sampler(_Object):
    mag_filter: int | None = None
    min_filter: int | None = None
    wrap_s: int | None = None
    wrap_t: int | None = None


class Texture(_Object):
    extensions: Extensions = None
    sampler: int | None = None
    source: int | None = None


class TextureInfo(_Object):
    extensions: Extensions = None
    index: int | None = None
    scale: float | None = None
    """Of normal maps."""
    strength: float | None = None
    """Of occlusion maps."""
    tex_coord: int | None = None


class MetallicRoughness(_Object):
    base_color_factor: list[float] | None = None
    base_color_texture: TextureInfo | None = None
    metallic_factor: float | None = None
    metallic_roughness_texture: TextureInfo | None = None
    roughness_factor: float | None = None


class Material(_Object):
    alpha_cutoff: float | None = None
    alpha_mode: str | None = None
    double_sided: bool | None = None
    emissive_factor: list[float] | None = None
    emissive_texture: TextureInfo | None = None
    extensions: Extensions = None
    name: str | None = None
    normal_texture: TextureInfo | None = None
    occlusion_texture: TextureInfo | None = None
    pbr_metallic_roughness: MetallicRoughness | None = None


class Perspective(_Object):
    aspect_ratio: float | None = None
    yfov: float | None = None
    zfar: float | None = None
    znear: float | None = None


class Orthographic(_Object):
    zfar: float | None = None
    znear: float | None = None


class Camera(_Object):
    name: str | None = None
    orthographic: Orthographic | None = None
    perspective: Perspective | None = None


class Document(_Object):
    accessors: list[Accessor | None] | None = None
    asset: Asset | None = None
    buffer_views: list[BufferView | None] | None = None
    buffers: list[Buffer | None] | None = None
    cameras: list[Camera | None] | None = None
    extensions: Extensions = None
    extensions_required: list[str | None] | None = None
    extensions_used: list[str | None] | None = None
    images: list[Image | None] | None = None
    materials: list[Material | None] | None = None
    meshes: list[Mesh | None] | None = None
    nodes: list[Node | None] | None = None
    samplers: list[Sampler | None] | None = None
    scene: int | None = None
    scenes: list[Scene | None] | None = None
    textures: list[Texture | None] | None = None


class TextureTransform(_Object):
    """KHR_texture_transform."""

    offset: list[float] | None = None
    rotation: float | None = None
    scale: list[float] | None = None
    tex_coord: int | None = None


class ImageSource(_Object):
    """EXT_texture_webp and its kin: another image for a texture."""

    source: int | None = None


class EmissiveStrength(_Object):
    """KHR_materials_emissive_strength."""

    emissive_strength: float | None = None


class Ior(_Object):
    """KHR_materials_ior."""

    ior: float | None = None


class Specular(_Object):
    """KHR_materials_specular."""

    specular_color_factor: list[float] | None = None
    specular_color_texture: TextureInfo | None = None
    specular_factor: float | None = None
    specular_texture: TextureInfo | None = None


class SpecularGlossiness(_Object):
    """KHR_materials_pbrSpecularGlossiness (archived)."""

    diffuse_factor: list[float] | None = None
    diffuse_texture: TextureInfo | None = None
    glossiness_factor: float | None = None
    specular_factor: list[float] | None = None
    specular_glossiness_texture: TextureInfo | None = None


class Spot(_Object):
    inner_cone_angle: float | None = None
    outer_cone_angle: float | None = None


class Light(_Object):
    """An entry of KHR_lights_punctual."""

    color: list[float] | None = None
    intensity: float | None = None
    name: str | None = None
    range: float | None = None
    spot: Spot | None = None
    type: str | None = None


class Lights(_Object):
    """KHR_lights_punctual of the document."""

    lights: list[Light | None] | None = None


class LightReference(_Object):
    """KHR_lights_punctual of a node."""

    light: int | None = None


_DECODER: Final = msgspec.json.Decoder(Document)


def parse(text: bytes, limits: GltfLimits) -> Document:
    """The document of JSON ``text`` (UTF-8, with or without a byte order mark).

    Raises:
        GltfError: not JSON, not a glTF document, or larger than ``limits`` allow.
    """
    if len(text) > limits.max_json_bytes:
        raise GltfError(f"the JSON text has {len(text)} bytes, more than max_json_bytes = {limits.max_json_bytes}")
    if (values := count_values(text, limits)) > limits.max_json_values:
        raise GltfError(
            f"the JSON text has about {values} values, more than max_json_values = {limits.max_json_values}"
        )
    text = text.removeprefix(b"\xef\xbb\xbf")
    try:
        try:
            document = _DECODER.decode(text)
        except (msgspec.MsgspecError, ValueError):
            document = _parse_leniently(text)
    except RecursionError as error:
        raise GltfError("the JSON text is nested too deeply") from error
    _check_version(document)
    return document


def count_values(text: bytes, limits: GltfLimits) -> int:
    """About how many values JSON ``text`` has, 0 if its length alone tells that they are not too many."""
    if len(text) <= limits.max_json_values:
        return 0
    return text.count(b",") + text.count(b"{") + text.count(b"[")


def _parse_leniently(text: bytes) -> Document:
    """Accepts what msgspec does not but some exporters write: NaN, Infinity (as null), 3.0 where an integer belongs."""
    try:
        value = json.loads(text, parse_constant=lambda _: None, parse_float=_number)
    except ValueError as error:
        raise GltfError(f"not JSON: {error}") from error
    if not isinstance(value, dict):
        raise GltfError(f"a glTF document is a JSON object, not {_json_type(value)}")
    try:
        return msgspec.json.decode(msgspec.json.encode(value), type=Document)
    except (msgspec.MsgspecError, ValueError, OverflowError) as error:
        raise GltfError(_sentence(str(error))) from error


def _number(text: str) -> float | int | None:
    check_stop()
    value = float(text)
    if not math.isfinite(value):
        return None
    return int(value) if value.is_integer() and abs(value) < 2**53 else value


def _json_type(value: object) -> str:
    names = {list: "an array", str: "a string", bool: "a boolean", int: "a number", float: "a number"}
    return names.get(type(value), "null")


def _sentence(message: str) -> str:
    """msgspec's "Expected `int`, got `str` - at `$.nodes[3].mesh`" with the place first, as in our own messages."""
    what, separator, place = message.partition(" - at `")
    if not separator:
        return message
    return f"{place.rstrip('`').removeprefix('$').removeprefix('.') or 'the document'}: {what[:1].lower()}{what[1:]}"


def _check_version(document: Document) -> None:
    if document.asset is None:
        return
    version, least = document.asset.version, document.asset.min_version
    # As glTF 2.0, 3.2, says: a least version counts to its minor number, of a version alone only the major one does.
    if least is not None and least != "2.0":
        raise GltfError(f"asset.minVersion: the file asks for glTF {least[:16]}, but only 2.0 is read")
    if version is not None and version.split(".")[0] != "2":
        raise GltfError(f"asset.version: glTF {version[:16]} is not supported, only 2.x")


def vector(values: list[float] | None, default: tuple[float, ...], where: str) -> tuple[Any, ...]:
    """``values`` as a tuple as long as ``default``, which stands for null.

    Raises:
        GltfError: another length, or a value that is not finite.
    """
    if values is None:
        return default
    if len(values) != len(default):
        raise GltfError(f"{where}: {len(values)} numbers instead of {len(default)}")
    # A sum is finite if all of its terms are, but for those that overflow together.
    if not math.isfinite(sum(values)) and not all(map(math.isfinite, values)):
        raise GltfError(f"{where}: not finite")
    return tuple(values)


def extension(extensions: Extensions, name: str) -> msgspec.Raw | None:
    """The raw JSON of an extension, or None when it is absent or null."""
    raw = extensions.get(name) if extensions else None
    return None if raw is None or bytes(raw) == b"null" else raw
