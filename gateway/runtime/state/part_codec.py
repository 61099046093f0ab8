"""Geometry and materials as bytes, without loss: a pickle without classes, and blobs for what is large or shared.

A pickle that names a class could run any code when it is read. These hold numbers, text, bytes, tuples and dictionaries
only; everything else is a "persistent id" of the pickle module, a tuple that starts with a tag::

    ("value", class, {field: value})     ("number", value)     ("map", {name: value})     ("identity",)
    ("array", dtype, shape, sha256)      ("shared", sha256)    ("image", maximum pixels, sha256)

``shared`` is for materials and meshes, and for the parts of a node. Equal blobs are decoded to one object.
"""

import hashlib
import io
import pickle
from collections.abc import Callable, Mapping
from dataclasses import fields
from enum import Enum
from types import MappingProxyType
from typing import Any, Final

import msgspec
import numpy as np

from gateway.scene.tree.geometry import SHAPES, Part
from gateway.scene.tree.transforms import IDENTITY
from renderers.drawlist import AlphaMode, Image, LightKind, Material, Mesh, Sampler, Texture, Wrap
from renderers.encode import png_pixels
from renderers.images import image_from_bytes
from scenegate.messages.geometry import Solid, fields_of

CLASSES: Final[Mapping[str, type[Any]]] = MappingProxyType(
    {cls.__name__: cls for cls in (*SHAPES, Part, Material, Mesh, Sampler, Texture, AlphaMode, LightKind, Wrap)}
)
_PLAIN: Final = frozenset({type(None), bool, int, float, str, bytes, tuple, dict})
_ARRAY_KINDS: Final = frozenset("fiub")
"""Kinds of array elements: numbers and booleans, never objects."""

Blobs = dict[bytes, "bytes | memoryview"]
"""Blobs by SHA-256."""


def _field_names(cls: type[Any]) -> tuple[str, ...]:
    if issubclass(cls, Enum):
        return ("value",)
    if issubclass(cls, Solid):
        return tuple(field.name for field in fields_of(cls))
    return cls.__struct_fields__ if issubclass(cls, msgspec.Struct) else tuple(field.name for field in fields(cls))


_FIELDS: Final[Mapping[type[Any], tuple[str, ...]]] = {cls: _field_names(cls) for cls in CLASSES.values()}


class PartEncoder:
    """Encodes the parts of one transaction. The parts must exist as long as the encoder, which identifies shared
    objects by their ids."""

    def __init__(self) -> None:
        self._encoded: dict[int, tuple[bytes, Blobs]] = {}
        """Results by object id."""

    def encode(self, value: tuple[Part, ...] | Material | Mesh) -> tuple[bytes, Blobs]:
        """Return the digest of a value, and all its blobs. Arrays are not copied."""
        if id(value) not in self._encoded:
            blobs: Blobs = {}
            output = io.BytesIO()
            pickler = pickle.Pickler(output, protocol=5)
            pickler.fast = True  # equal values have equal bytes, whatever objects they share
            pickler.persistent_id = lambda each: self._tagged(  # type: ignore[method-assign]  # as documented
                each, blobs, is_whole=each is value
            )
            pickler.dump(value)
            self._encoded[id(value)] = _add_blob(blobs, output.getvalue()), blobs
        return self._encoded[id(value)]

    def _tagged(self, value: Any, blobs: Blobs, *, is_whole: bool) -> tuple[Any, ...] | None:
        """Return the persistent id of a value; None for one of pickle's own types."""
        value_type = type(value)
        if value_type in _PLAIN:
            return None
        if value_type in (Material, Mesh) and not is_whole:
            digest, own_blobs = self.encode(value)
            blobs.update(own_blobs)
            return "shared", digest
        if value_type in _FIELDS:
            return "value", value_type.__name__, {name: getattr(value, name) for name in _FIELDS[value_type]}
        if value is IDENTITY:
            return ("identity",)
        if isinstance(value, np.generic):
            return "number", value.item()
        if isinstance(value, Mapping):
            return "map", dict(value)
        if isinstance(value, np.ndarray) and value.dtype.kind in _ARRAY_KINDS:
            numbers = np.ascontiguousarray(value).reshape(-1).view(np.uint8).data
            return "array", value.dtype.str, value.shape, _add_blob(blobs, numbers)
        if isinstance(value, Image):
            file, max_pixels = getattr(value.decode, "data", None), getattr(value.decode, "max_pixels", None)
            if file is None or max_pixels is None:  # the image is not from a file: store its pixels
                pixels = value.decode()
                file, max_pixels = png_pixels(pixels), max(1, pixels.shape[0] * pixels.shape[1])
            return "image", max_pixels, _add_blob(blobs, file)
        raise TypeError(f"geometry with {getattr(value, 'dtype', value_type.__name__)} cannot be stored")


def _add_blob(blobs: Blobs, data: bytes | memoryview) -> bytes:
    digest = hashlib.sha256(data).digest()
    blobs[digest] = data
    return digest


class PartDecoder:
    """Decodes parts. Equal materials, meshes and arrays become one object."""

    def __init__(self, blob: Callable[[bytes], bytes]) -> None:
        """``blob`` returns the blob with a digest, or raises any exception."""
        self._blob = blob
        self._decoded: dict[tuple[Any, ...], Any] = {}
        """What was made of blobs, by tag."""

    def decode(self, digest: bytes) -> Any:
        """Return a value of ``PartEncoder`` by its digest. Damaged bytes raise any exception."""
        return self._value(("shared", digest))

    def _value(self, tagged: tuple[Any, ...]) -> Any:
        match tagged:
            case "value", name, values:
                return CLASSES[name](**values)
            case "number", value:
                return value
            case "map", values:
                return MappingProxyType(values)
            case ("identity",):
                return IDENTITY
        if tagged not in self._decoded:
            data = self._blob(tagged[-1])
            if hashlib.sha256(data).digest() != tagged[-1]:
                raise ValueError("a blob does not match its digest")
            match tagged:
                case "shared", _:
                    unpickler = _Unpickler(io.BytesIO(data))
                    unpickler.persistent_load = self._value  # type: ignore[method-assign]  # as documented
                    self._decoded[tagged] = unpickler.load()
                case "image", max_pixels, _:
                    self._decoded[tagged] = image_from_bytes(data, max_pixels=max_pixels)
                case "array", dtype, shape, _:
                    self._decoded[tagged] = np.ndarray(shape, dtype, data)
        return self._decoded[tagged]


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """Refuse all classes and functions."""
        raise ValueError(f"it names {module}.{name}")
