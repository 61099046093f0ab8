"""Rules that the OpenAPI description does not have: valid files, and relations between two values.

Schemathesis loads this file in its own interpreter (``hooks`` in schemathesis.toml): nothing of the gateway is here.
"""

import json
import math
import struct
import zlib
from collections.abc import Mapping
from typing import Any

import schemathesis  # type: ignore[import-not-found]  # in the interpreter that loads this file
from hypothesis import strategies as st

SIDE = 16
"""Pixels; the smallest image that the stereo camera's test mode takes."""
UNKNOWN = "x-schemathesis-unknown-property"
"""Query parameter that Schemathesis adds."""
MAX_PIXELS = 1 << 20
"""Pixel limit of generated image sizes: below the server's, so that the run stays short."""


def _png() -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", SIDE, SIDE, 8, 0, 0, 0, 0)
    rows = b"".join(b"\0" + bytes(range(row, row + SIDE)) for row in range(SIDE))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


schemathesis.openapi.media_type("image/png", st.just(_png()), aliases=["image/jpeg", "image/webp"])

CAMERA = {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01, "zfar": 10.0}}
SCENE = json.dumps(
    {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"camera": 0}], "cameras": [CAMERA]}
)


@schemathesis.hook  # type: ignore[untyped-decorator]  # as above
def before_call(context: Any, case: Any, kwargs: dict[str, Any]) -> None:
    """Put a scene that can be read in the place of arbitrary bytes, and a parameter's value in that of others."""
    if not isinstance(case.body, Mapping):
        return
    positive = case.meta is not None and case.meta.generation.mode.is_positive
    if isinstance(case.body.get("scene"), bytes | str) and _agree(case.body):
        case.body = {**case.body, "scene": SCENE}
    elif positive and case.operation.path.endswith("/parameters/{name}"):
        case.body = {**case.body, "value": _value_of(case)}


def _value_of(case: Any) -> Any:
    """A value of a parameter of the stereo camera, as the route that sets several describes it."""
    path = case.operation.path.removesuffix("/{name}")
    body = case.operation.schema.raw_schema["paths"][path]["put"]["requestBody"]
    for entry in body["content"]["application/json"]["schema"]["items"]["anyOf"]:
        if entry["properties"]["name"]["const"] == case.path_parameters["name"]:
            schema = entry["properties"]["value"]
            return schema["enum"][-1] if "enum" in schema else schema["maximum"]
    return case.body["value"]


@schemathesis.hook  # type: ignore[untyped-decorator]  # as above
def filter_case(context: Any, case: Any) -> bool:
    """Drop requests whose values are each as described but contradict one another, and those with unknown parameters.

    OpenAPI cannot forbid parameters that it does not name, and the server ignores them.
    """
    if UNKNOWN in (case.query or {}):
        return False
    if case.meta is None or case.meta.generation.mode.is_negative:
        return True
    return _agree(case.body if isinstance(case.body, Mapping) else case.query or {})


def _agree(values: Mapping[str, Any]) -> bool:
    return (
        _number(values, "near", 0) < _number(values, "far", math.inf)
        and _number(values, "min_depth", 0) < _number(values, "max_depth", math.inf)
        and _number(values, "center_x", 0) < _number(values, "width", math.inf)
        and _number(values, "center_y", 0) < _number(values, "height", math.inf)
        and _number(values, "width", 1) * _number(values, "height", 1) <= MAX_PIXELS
        and _looks_somewhere(str(values.get("camera", "")))
    )


def _number(values: Mapping[str, Any], name: str, default: float) -> float:
    """A value, which may be text already; the default where it is missing or no number."""
    try:
        return float(values.get(name, default))
    except (TypeError, ValueError):
        return default


def _looks_somewhere(camera: str) -> bool:
    """Return True if eye and target differ and up is not zero."""
    parts = dict(part.split("=", 1) for part in camera.split(";") if "=" in part)
    vectors = {name: [float(value) for value in text.split(",")] for name, text in parts.items() if name != "fovy"}
    return vectors.get("eye", [0]) != vectors.get("target", [1]) and any(vectors.get("up", [1]))
