"""Parses the JSON text of a document, and of its extensions, to the types of ``schema``."""

from __future__ import annotations

import functools
import json
import re
import sys
from collections.abc import Callable
from typing import Any, Final, TypeVar

import msgspec
from msgspec import inspect

from gateway.gltf.errors import GltfError, GltfLimitError, as_warning
from gateway.gltf.limits import GltfLimits
from gateway.gltf.schema import Document, Extensions, Object
from renderers.stop import check_stop

_MAX_FLOAT: Final = sys.float_info.max
_MAX_QUOTED_CHARACTERS: Final = 60
"""Maximum number of characters of a JSON value in a message."""
_UNPAIRED_SURROGATE: Final = re.compile("[\ud800-\udfff]")
"""An escape such as ``\\ud800`` without its second half, which JSON allows and UTF-8 does not."""
_TYPES: Final[dict[type[inspect.Type], tuple[str, Callable[[Any], bool]]]] = {
    inspect.BoolType: ("true or false", lambda value: type(value) is bool),
    inspect.IntType: ("an integer", lambda value: type(value) is int),
    inspect.FloatType: ("a finite number", lambda value: type(value) in (int, float) and abs(value) <= _MAX_FLOAT),
    inspect.StrType: ("a string", lambda value: type(value) is str and not _UNPAIRED_SURROGATE.search(value)),
    inspect.ListType: ("an array", lambda value: False),
    inspect.DictType: ("an object", lambda value: False),
    inspect.StructType: ("an object", lambda value: False),
}
"""Names of types for messages, and whether a value without parts has that type."""

_Object = TypeVar("_Object", bound=Object)
_decoder: Final = functools.cache(msgspec.json.Decoder)
_type_info: Final = functools.cache(inspect.type_info)


def parse_document(text: bytes, limits: GltfLimits, warnings: list[str]) -> Document:
    """Parse JSON ``text`` (UTF-8, with or without a byte order mark).

    Args:
        warnings: A sentence about each property of another type than the schema's is appended to this list.

    Raises:
        GltfError: The text is not a JSON object, or beyond ``limits``.
    """
    if len(text) > limits.max_json_bytes:
        raise GltfLimitError(f"the JSON text has {len(text)} bytes, more than max_json_bytes = {limits.max_json_bytes}")
    # A value takes at least one byte, so the values of a short text need not be counted.
    if len(text) > limits.max_json_values and (value_count := count_values(text)) > limits.max_json_values:
        raise GltfLimitError(
            f"the JSON text has about {value_count} values, more than max_json_values = {limits.max_json_values}"
        )
    document: Document = _decode(text.removeprefix(b"\xef\xbb\xbf"), Document, "", warnings, _read)
    return document


def count_values(text: bytes) -> int:
    """Return the approximate number of values in JSON ``text``: its commas, opening braces and opening brackets."""
    return text.count(b",") + text.count(b"{") + text.count(b"[")


def extension(
    extensions: Extensions, name: str, type_: type[_Object], path: str, warnings: list[str]
) -> _Object | None:
    """Return an extension as a ``type_``; None if it is absent, null or, with a warning, not an object.

    Args:
        path: The object with the extension, for messages; empty for the document.
        warnings: A sentence about each property of another type is appended to this list.

    Raises:
        GltfError: ``type_`` has essential properties, and one of them has another type, or it is not an object.
    """
    raw = extensions.get(name) if extensions else None
    if raw is None or bytes(raw) == b"null":
        return None
    read = _read if type_.essential != () else _read_or_none
    found: _Object | None = _decode(raw, type_, _joined(path, f"extensions.{name}"), warnings, read)
    return found


def _decode(
    text: bytes | msgspec.Raw, type_: type[Object], path: str, warnings: list[str], read: Callable[..., Any]
) -> Any:
    """Return JSON text as a ``type_``; if it has parts of other types, the result of ``read``."""
    try:
        try:
            return _decoder(type_).decode(text)
        except (msgspec.MsgspecError, ValueError):  # ValueError: text that is not UTF-8
            value = json.loads(bytes(text), parse_float=_number)
        return read(value, _type_info(type_), path, warnings)
    except GltfError:
        raise
    except ValueError as error:
        raise GltfError(f"not JSON: {error}") from error
    except RecursionError as error:
        raise GltfError("the JSON text is nested too deeply") from error


def _number(text: str) -> float:
    """Return an integer for a whole number, which some exporters write as 3.0; infinity for 1e999."""
    check_stop()
    value = float(text)
    return int(value) if value.is_integer() and abs(value) < 2**53 else value


def _read(value: Any, info: inspect.Type, path: str, warnings: list[str]) -> Any:
    """Return a parsed JSON value as a type of the schema.

    A property or an item of another type becomes None, with a warning, unless it is essential. An object in a list
    becomes its error, which is raised where the object is used.

    Raises:
        GltfError: The value has another type, or something essential in it.
    """
    if isinstance(info, inspect.UnionType):
        if value is None:
            return None
        info = info.types[0]  # the other one is null
    if isinstance(info, inspect.StructType) and isinstance(value, dict):
        check_stop()
        essential = info.cls.essential  # type: ignore[attr-defined]  # a class of the schema
        properties: dict[str, Any] = {}
        for field in info.fields:
            if (part := value.get(field.encode_name)) is not None:
                read = _read if essential is None or field.name in essential else _read_or_none
                properties[field.name] = read(part, field.type, _joined(path, field.encode_name), warnings)
        return info.cls(**properties)
    if isinstance(info, inspect.ListType) and isinstance(value, list):
        return [_read_item(item, info.item_type, f"{path}[{i}]", warnings) for i, item in enumerate(value)]
    if isinstance(info, inspect.DictType) and isinstance(value, dict):
        return {key: _read_item(item, info.value_type, _joined(path, key), warnings) for key, item in value.items()}
    if isinstance(info, inspect.RawType):
        return msgspec.Raw(json.dumps(value).encode())
    expected, is_valid = _TYPES[type(info)]
    if not is_valid(value):
        raise GltfError(f"{path or 'glTF'}: expected {expected}, got {json.dumps(value)[:_MAX_QUOTED_CHARACTERS]}")
    return value


def _read_or_none(value: Any, info: inspect.Type, path: str, warnings: list[str]) -> Any:
    """Return ``_read``, or None with a warning."""
    try:
        return _read(value, info, path, warnings)
    except GltfError:
        with as_warning(warnings, "it is ignored"):
            raise
    return None


def _read_item(value: Any, info: inspect.Type, path: str, warnings: list[str]) -> Any:
    """Return ``_read`` for an item of a list or dict; for another type the error if the schema has an object, else
    None with a warning. Where items cannot be null, as in vectors, the error is raised.
    """
    if not isinstance(info, inspect.UnionType):
        return _read(value, info, path, warnings)
    if not isinstance(info.types[0], inspect.StructType):
        return _read_or_none(value, info, path, warnings)
    try:
        return _read(value, info, path, warnings)
    except GltfError as error:
        return error.with_traceback(None)


def _joined(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def check_version(document: Document, warnings: list[str]) -> None:
    """Warn about a document that needs a later minor version than 2.0.

    Raises:
        GltfError: The document has another major version.
    """
    if document.asset is None:
        return
    for name, version in (("version", document.asset.version), ("minVersion", document.asset.min_version)):
        if version is not None and version.split(".")[0] != "2":
            raise GltfError(f"asset.{name}: glTF {version[:16]} is not supported, only 2.x")
    if document.asset.min_version not in (None, "2.0"):
        warnings.append(f"asset.minVersion: glTF {document.asset.min_version[:16]} is read as glTF 2.0")


def vector_or_default(
    values: list[float] | None, path: str, default: tuple[float, ...], warnings: list[str]
) -> tuple[Any, ...]:
    """Return ``values`` as a tuple; ``default`` for null, and with a warning for another number of values.

    Args:
        path: Name of the property, for messages.
        default: Default value. Its length is the required length of ``values``.
    """
    if values is None:
        return default
    if len(values) != len(default):
        warnings.append(f"{path}: {len(values)} numbers instead of {len(default)}; it is ignored")
        return default
    return tuple(values)
