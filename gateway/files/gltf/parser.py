"""Parses the JSON text of a document, and of its extensions, to the types of ``schema``."""

import functools
import json
import re
import sys
from collections.abc import Callable
from typing import Any, Final, TypeVar

import msgspec
from msgspec import inspect

from gateway.files.gltf import schema
from gateway.files.gltf.gltf_errors import GltfError, GltfLimitError, GltfLimits, as_warning
from gateway.files.gltf.schema import Document, Extensions, Object
from renderers.stop import check_stop
from scenegate.warning_text import ONLY_GLOSS

_MAX_FLOAT: Final = sys.float_info.max
_MAX_QUOTED_CHARACTERS: Final = 60
"""Maximum number of characters of a JSON value in a message."""
_SUPPORTED_EXTENSIONS: Final = frozenset(
    {
        "EXT_mesh_gpu_instancing",
        "EXT_meshopt_compression",
        "EXT_texture_webp",
        "KHR_accessor_float64",
        "KHR_draco_mesh_compression",
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_materials_variants",
        "KHR_mesh_quantization",
        "KHR_meshopt_compression",
        "KHR_node_visibility",
        "KHR_texture_transform",
    }
)
_IMAGE_FORMATS: Final = frozenset({"KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds"})
"""Extensions that offer another image for a texture. They give no warning here: the texture's own image (PNG or JPEG)
is used, and ``textures`` warns about a texture without one."""
_INVISIBLE_EXTENSIONS: Final = frozenset(
    {
        "EXT_instance_features",
        "EXT_mesh_features",
        "EXT_mesh_manifold",
        "EXT_mesh_primitive_restart",  # other index lists of strips that are drawn from their own
        "EXT_structural_metadata",
        "FB_ngon_encoding",
        "GODOT_single_root",
        "KHR_interactivity",
        "KHR_node_hoverability",
        "KHR_node_selectability",
        "KHR_xmp_json_ld",
        "OMI_collider",
        "OMI_physics_body",
        "OMI_physics_gravity",
        "OMI_physics_joint",
        "OMI_physics_shape",
    }
)
"""Extensions that change no image, such as metadata and physics; ignoring them is no loss."""
_GLOSS_EXTENSIONS: Final = frozenset(
    f"KHR_materials_{name}" for name in ("anisotropy", "clearcoat", "dispersion", "iridescence", "sheen")
)
"""Extensions that change only reflections; ignoring them is a note."""
_MAX_LISTED_CHARACTERS: Final = 500
"""Maximum number of characters of extension names in a message."""
_UNPAIRED_SURROGATE: Final = re.compile("[\ud800-\udfff]")
"""An escape such as ``\\ud800`` without its second half, which JSON allows and UTF-8 does not."""
_TYPE_CHECKS: Final[dict[type[inspect.Type], tuple[str, Callable[[Any], bool]]]] = {
    inspect.BoolType: ("true or false", lambda value: type(value) is bool),
    inspect.IntType: ("an integer", lambda value: type(value) is int),
    inspect.FloatType: ("a finite number", lambda value: type(value) in (int, float) and abs(value) <= _MAX_FLOAT),
    inspect.StrType: ("a string", lambda value: type(value) is str and not _UNPAIRED_SURROGATE.search(value)),
    inspect.ListType: ("an array", lambda value: False),
    inspect.DictType: ("an object", lambda value: False),
    inspect.StructType: ("an object", lambda value: False),
}
"""Name of each type, for messages, and a check of values. Valid arrays and objects are converted item by item before
this check, so that it fails for whatever is left."""

_Object = TypeVar("_Object", bound=Object)
_DECODERS: Final = {
    each: msgspec.json.Decoder(each)
    for each in vars(schema).values()
    if isinstance(each, type) and issubclass(each, Object)
}
"""Decoder of each type. msgspec crashes if two threads make the first decoder of a type at the same time."""
_type_info: Final = functools.cache(inspect.type_info)


def parse_document(text: bytes, limits: GltfLimits, warnings: list[str]) -> Document:
    """Parse JSON (UTF-8, perhaps with a byte order mark). Raises GltfError: no object, or beyond ``limits``."""
    if len(text) > limits.max_json_bytes:
        raise GltfLimitError(f"the JSON text has {len(text)} bytes, more than max_json_bytes = {limits.max_json_bytes}")
    # A value takes at least one byte, so the values of a short text need not be counted.
    if len(text) > limits.max_json_values and (value_count := count_values(text)) > limits.max_json_values:
        raise GltfLimitError(
            f"the JSON text has about {value_count} values, more than max_json_values = {limits.max_json_values}"
        )
    document: Document = _decode(text.removeprefix(b"\xef\xbb\xbf"), Document, "", warnings, _convert)
    return document


def count_values(text: bytes) -> int:
    """Return the approximate number of values in JSON ``text``: its commas, opening braces and opening brackets."""
    return text.count(b",") + text.count(b"{") + text.count(b"[")


def extension(
    extensions: Extensions, name: str, type_: type[_Object], path: str, warnings: list[str]
) -> _Object | None:
    """Return an extension as a ``type_``; None if it is absent or null.

    An extension that is not an object is None, too, with a warning, if ``type_`` has no essential properties. If it
    has, GltfError is raised for a wrong type of it or of one of them. ``path``: the object with the extension; empty
    for the document.
    """
    raw = extensions.get(name) if extensions else None
    if raw is None or bytes(raw) == b"null":
        return None
    convert = _convert if type_.essential != () else _convert_or_none
    found: _Object | None = _decode(raw, type_, _child_path(path, f"extensions.{name}"), warnings, convert)
    return found


def _decode(
    text: bytes | msgspec.Raw, type_: type[Object], path: str, warnings: list[str], convert: Callable[..., Any]
) -> Any:
    """Return JSON text as a ``type_``.

    msgspec rejects the whole text if one value has a wrong type. Such a text is parsed by ``json`` instead, and
    ``convert`` (``_convert`` or ``_convert_or_none``) checks each value.
    """
    try:
        try:
            return _DECODERS[type_].decode(text)
        except (msgspec.MsgspecError, ValueError):  # ValueError: text that is not UTF-8
            value = json.loads(bytes(text), parse_float=_parse_float)
        return convert(value, _type_info(type_), path, warnings)
    except GltfError:
        raise
    except ValueError as error:
        raise GltfError(f"not JSON: {error}") from error
    except RecursionError as error:
        raise GltfError("the JSON text is nested too deeply") from error


def _parse_float(text: str) -> float:
    """Parse a number with a point or an exponent. Some exporters write integers so: 3.0 becomes 3.

    A number that is too large becomes infinity, which the check of its type rejects.
    """
    check_stop()
    value = float(text)
    return int(value) if value.is_integer() and abs(value) < 2**53 else value


def _convert(value: Any, info: inspect.Type, path: str, warnings: list[str]) -> Any:
    """Return a parsed JSON value as a type of the schema. For items of lists see ``_convert_item``.

    A property of a wrong type becomes None, with a warning. Raises GltfError if the value, or an essential property in
    it, has one.
    """
    if isinstance(info, inspect.UnionType):
        if value is None:
            return None
        info = info.types[0]  # the other type is null
    if isinstance(info, inspect.StructType) and isinstance(value, dict):
        check_stop()
        essential = info.cls.essential  # type: ignore[attr-defined]  # a class of the schema
        properties: dict[str, Any] = {}
        for field in info.fields:
            if (part := value.get(field.encode_name)) is not None:
                convert = _convert if essential is None or field.name in essential else _convert_or_none
                properties[field.name] = convert(part, field.type, _child_path(path, field.encode_name), warnings)
        return info.cls(**properties)
    if isinstance(info, inspect.ListType) and isinstance(value, list):
        return [_convert_item(item, info.item_type, f"{path}[{i}]", warnings) for i, item in enumerate(value)]
    if isinstance(info, inspect.DictType) and isinstance(value, dict):
        return {
            key: _convert_item(item, info.value_type, _child_path(path, key), warnings) for key, item in value.items()
        }
    if isinstance(info, inspect.RawType):
        return msgspec.Raw(json.dumps(value).encode())
    expected, is_valid = _TYPE_CHECKS[type(info)]
    if not is_valid(value):
        raise GltfError(f"{path or 'glTF'}: expected {expected}, got {json.dumps(value)[:_MAX_QUOTED_CHARACTERS]}")
    return value


def _convert_or_none(value: Any, info: inspect.Type, path: str, warnings: list[str]) -> Any:
    """Return the result of ``_convert``; None and a warning if it raises GltfError."""
    with as_warning(warnings, "it is ignored"):
        return _convert(value, info, path, warnings)
    return None


def _convert_item(value: Any, info: inspect.Type, path: str, warnings: list[str]) -> Any:
    """Return the result of ``_convert`` for an item of a list or dict.

    If the item is invalid, the declared type decides:

    * Items that cannot be null, such as the numbers of a vector: the error is raised.
    * Objects: the error is returned. ``checked_item`` raises it where the object is used.
    * Others: None, with a warning.
    """
    if not isinstance(info, inspect.UnionType):
        return _convert(value, info, path, warnings)
    if not isinstance(info.types[0], inspect.StructType):
        return _convert_or_none(value, info, path, warnings)
    try:
        return _convert(value, info, path, warnings)
    except GltfError as error:
        return error.with_traceback(None)


def _child_path(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def check_version(document: Document, warnings: list[str]) -> None:
    """Warn of a document that needs a later minor version than 2.0. Raises GltfError for another major version."""
    if document.asset is None:
        return
    for name, version in (("version", document.asset.version), ("minVersion", document.asset.min_version)):
        if version is not None and version.split(".")[0] != "2":
            raise GltfError(f"asset.{name}: glTF {version[:16]} is not supported, only 2.x")
    if document.asset.min_version not in (None, "2.0"):
        warnings.append(f"asset.minVersion: glTF {document.asset.min_version[:16]} is read as glTF 2.0")


def check_extensions(document: Document, warnings: list[str]) -> None:
    """Warn about extensions that are ignored. Required ones are no error, as in other viewers."""
    names = {name for name in (*(document.extensions_required or ()), *(document.extensions_used or ())) if name}
    materials = (each for each in document.materials or () if isinstance(each, schema.GltfMaterial))
    of_materials = {name for each in materials for name in each.extensions or ()}
    # Assimp lists KHR_materials_volume in all of its files.
    unused = {name for name in names if name.startswith("KHR_materials_") and name not in of_materials}
    ignored = sorted(names - _SUPPORTED_EXTENSIONS - _IMAGE_FORMATS - _INVISIBLE_EXTENSIONS - unused)
    for group, end in (
        ([name for name in ignored if name not in _GLOSS_EXTENSIONS], ""),
        ([name for name in ignored if name in _GLOSS_EXTENSIONS], f", {ONLY_GLOSS}"),
    ):
        if group:
            warnings.append(f"extensionsUsed: {', '.join(group)[:_MAX_LISTED_CHARACTERS]} ignored{end}")


def vector_or_default(
    values: list[float] | None, path: str, default: tuple[float, ...], warnings: list[str]
) -> tuple[Any, ...]:
    """Return ``values`` as a tuple; ``default`` for None or, with a warning, if they are not as many."""
    if values is None:
        return default
    if len(values) != len(default):
        warnings.append(f"{path}: {len(values)} numbers instead of {len(default)}; it is ignored")
        return default
    return tuple(values)
