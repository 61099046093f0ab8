"""Parses the JSON text of a document to a ``schema.Document``; helpers for its vectors and extensions."""

from __future__ import annotations

import json
import math
from typing import Any, Final

import msgspec

from gateway.gltf.errors import GltfError, GltfLimitError
from gateway.gltf.limits import GltfLimits
from gateway.gltf.schema import Document, Extensions
from renderers.stop import check_stop

_DECODER: Final = msgspec.json.Decoder(Document)
_MAX_QUOTED_CHARACTERS: Final = 60
"""Maximum number of characters of a JSON string in an error message."""


def parse_document(text: bytes, limits: GltfLimits) -> Document:
    """Parse JSON ``text`` (UTF-8, with or without a byte order mark).

    Raises:
        GltfError: The text is not JSON, not a glTF 2 document, or beyond ``limits``.
    """
    if len(text) > limits.max_json_bytes:
        raise GltfLimitError(f"the JSON text has {len(text)} bytes, more than max_json_bytes = {limits.max_json_bytes}")
    # A value takes at least one byte, so the values of a short text need not be counted.
    if len(text) > limits.max_json_values and (value_count := count_values(text)) > limits.max_json_values:
        raise GltfLimitError(
            f"the JSON text has about {value_count} values, more than max_json_values = {limits.max_json_values}"
        )
    text = text.removeprefix(b"\xef\xbb\xbf")
    try:
        try:
            document = _DECODER.decode(text)
        except (msgspec.MsgspecError, ValueError):
            document = _parse_leniently(text)
    except RecursionError as error:
        raise GltfError("the JSON text is nested too deeply") from error
    return document


def count_values(text: bytes) -> int:
    """Return the approximate number of values in JSON ``text``: its commas, opening braces and opening brackets."""
    return text.count(b",") + text.count(b"{") + text.count(b"[")


def _parse_leniently(text: bytes) -> Document:
    """Parse a document that some exporters write and msgspec rejects.

    Such a document has NaN or Infinity, which are read as null, or whole numbers such as 3.0 for integers.
    """
    try:
        value = json.loads(text, parse_constant=lambda _: None, parse_float=_parse_float)
    except ValueError as error:
        raise GltfError(f"not JSON: {error}") from error
    if not isinstance(value, dict):
        raise GltfError(f"a glTF document is a JSON object, not {_json_type(value)}")
    try:
        return msgspec.json.decode(msgspec.json.encode(value), type=Document)
    except UnicodeEncodeError as error:  # json.loads accepts an escape such as "\ud800" without its second half
        surrogate, start = error.object[error.start], error.object[:_MAX_QUOTED_CHARACTERS]
        raise GltfError(f"the JSON string {start!r} has an unpaired surrogate, {surrogate!r}") from error
    except (msgspec.MsgspecError, ValueError, OverflowError) as error:
        raise GltfError(_with_path_first(str(error))) from error


def _parse_float(text: str) -> float | int | None:
    """Return an integer for a whole number, and None for an overflow such as 1e999."""
    check_stop()
    value = float(text)
    if not math.isfinite(value):
        return None
    return int(value) if value.is_integer() and abs(value) < 2**53 else value


def _json_type(value: object) -> str:
    names = {list: "an array", str: "a string", bool: "a boolean", int: "a number", float: "a number"}
    return names.get(type(value), "null")


def _with_path_first(message: str) -> str:
    """Turn "Expected `int`, got `str` - at `$.nodes[3].mesh`" into "nodes[3].mesh: expected `int`, got `str`"."""
    reason, separator, path = message.partition(" - at `")
    if not separator:
        return message
    path = path.rstrip("`").removeprefix("$").removeprefix(".")
    return f"{path or 'the document'}: {reason[:1].lower()}{reason[1:]}"


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


def finite_vector_or_default(values: list[float] | None, default: tuple[float, ...], path: str) -> tuple[Any, ...]:
    """Return ``values`` as a tuple, or ``default`` for null.

    Args:
        default: Default value. Its length is the required length of ``values``.
        path: Name of the property, for messages.

    Raises:
        GltfError: ``values`` has another length, or a number that is not finite.
    """
    if values is None:
        return default
    if len(values) != len(default):
        raise GltfError(f"{path}: {len(values)} numbers instead of {len(default)}")
    if not all(map(math.isfinite, values)):
        raise GltfError(f"{path}: not finite")
    return tuple(values)


def extension_json(extensions: Extensions, name: str) -> msgspec.Raw | None:
    """Return the JSON text of an extension; None if it is absent or null."""
    raw = extensions.get(name) if extensions else None
    return None if raw is None or bytes(raw) == b"null" else raw
