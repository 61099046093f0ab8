"""Geometry and materials as bytes, without loss: a MessagePack structure, and blobs for large arrays and images.

Values of MessagePack's own types (None, bool, int, float, bytes, valid UTF-8 text) stand for themselves. Every other
value is a list that starts with a tag::

    ["text", UTF-8 with surrogates]          ["tuple", values]            ["map", {name: value}]
    ["value", class, {field: value}]         ["enum", class, value]       ["once", the bytes of a value]
    ["array", dtype, shape, bytes]           ["blob", dtype, shape, sha256]
    ["picture", name, maximum pixels, sha256]

``once`` is for materials and meshes, which many parts share: equal bytes are decoded to one object.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Hashable, Mapping
from dataclasses import fields
from enum import Enum
from types import MappingProxyType
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree.geometry import SHAPES, Part
from gateway.scene.tree.transforms import IDENTITY
from renderers.drawlist import AlphaMode, Image, ImageError, Material, Mesh, Sampler, Texture, Wrap
from renderers.encode import png_rgba
from renderers.images import image_from_bytes
from scenegate.messages.geometry import Solid, fields_of

INLINE_BYTES: Final = 256
"""Maximum bytes of an array inside the structure. As a blob, a small array would cost more than its content."""
CLASSES: Final[Mapping[str, type[Any]]] = MappingProxyType(
    {cls.__name__: cls for cls in (*SHAPES, Part, Material, Mesh, Sampler, Texture)}
)
_ENUMS: Final[Mapping[str, type[Enum]]] = MappingProxyType({cls.__name__: cls for cls in (AlphaMode, Wrap)})


def _field_names(cls: type[Any]) -> tuple[str, ...]:
    if issubclass(cls, Solid):
        return tuple(field.name for field in fields_of(cls))
    return cls.__struct_fields__ if issubclass(cls, msgspec.Struct) else tuple(field.name for field in fields(cls))


_FIELDS: Final[Mapping[type[Any], tuple[str, ...]]] = {cls: _field_names(cls) for cls in CLASSES.values()}
_SHARED: Final = (Material, Mesh)
"""Classes of objects that many parts share (``once``)."""
_ARRAY_KINDS: Final = frozenset("fiub")
"""Kinds of array elements: numbers and booleans, never objects."""
_IDENTITY: Final = IDENTITY.tobytes()

Blobs = dict[bytes, "bytes | memoryview"]
"""Blobs by SHA-256."""
_encoder: Final = msgspec.msgpack.Encoder()


class DamagedError(ValueError):
    """Stored bytes differ from what this module writes."""


def memo_key(parts: tuple[Part, ...]) -> Hashable:
    """Return a key of parts. Equal keys mean equal bytes, as long as the parts and their materials exist.

    Solids are compared by value, so that 1000 equal boxes are encoded once. Numbers are compared as they are stored:
    0.0 and -0.0 differ.
    """
    key = []
    for part in parts:
        if not isinstance(part.shape, Solid) or part.X_node_part is not IDENTITY:
            return id(parts)
        key.append((type(part.shape), _encoder.encode(part.shape), id(part.material), part.kind, part.source))
    return tuple(key)


class PartEncoder:
    """Encodes the parts of one transaction. The parts must exist as long as the encoder, which identifies shared
    objects by their ids."""

    def __init__(self) -> None:
        self._encoded: dict[int, tuple[bytes, Blobs]] = {}
        """Encoded materials and meshes by object id."""

    def encode(self, parts: tuple[Part, ...]) -> tuple[bytes, Blobs]:
        """Return the structure and its blobs. Arrays are not copied."""
        blobs: Blobs = {}
        return _encoder.encode([self._value(part, blobs) for part in parts]), blobs

    def _value(self, value: Any, blobs: Blobs) -> Any:
        value_type = type(value)
        if value is None or value_type in (bool, int, float, bytes):
            return value
        if value_type is str:
            try:
                value.encode()
            except UnicodeEncodeError:
                return ["text", value.encode("utf-8", "surrogatepass")]
            return value
        if value_type in _SHARED:
            return ["once", self._shared(value, blobs)]
        if value_type in _FIELDS:
            return self._fields(value, blobs)
        if isinstance(value, np.ndarray):
            return self._array(value, blobs)
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, Enum):
            return ["enum", value_type.__name__, value.value]
        if isinstance(value, tuple):
            return ["tuple", [self._value(entry, blobs) for entry in value]]
        if isinstance(value, Mapping):
            return ["map", [[self._value(k, blobs), self._value(v, blobs)] for k, v in value.items()]]
        if isinstance(value, Image):
            return self._image(value, blobs)
        raise TypeError(f"geometry with a {value_type.__name__} cannot be stored")

    def _fields(self, value: Any, blobs: Blobs) -> list[Any]:
        value_type = type(value)
        return [
            "value",
            value_type.__name__,
            {name: self._value(getattr(value, name), blobs) for name in _FIELDS[value_type]},
        ]

    def _shared(self, value: Any, blobs: Blobs) -> bytes:
        encoded = self._encoded.get(id(value))
        if encoded is None:
            value_blobs: Blobs = {}
            encoded = self._encoded[id(value)] = _encoder.encode(self._fields(value, value_blobs)), value_blobs
        blobs.update(encoded[1])
        return encoded[0]

    def _array(self, array: NDArray[Any], blobs: Blobs) -> list[Any]:
        if array.dtype.kind not in _ARRAY_KINDS:
            raise TypeError(f"an array of {array.dtype} cannot be stored")
        dtype, shape = array.dtype.str, list(array.shape)
        if array.nbytes <= INLINE_BYTES:
            return ["array", dtype, shape, array.tobytes()]
        data = np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
        return ["blob", dtype, shape, _add_blob(blobs, data)]

    def _image(self, image: Image, blobs: Blobs) -> list[Any]:
        data, max_pixels = getattr(image.decode, "data", None), getattr(image.decode, "max_pixels", None)
        if data is None or max_pixels is None:  # the image is not from a file: store its pixels
            pixels = image.decode()
            data, max_pixels = png_rgba(pixels), max(1, pixels.shape[0] * pixels.shape[1])
        return ["picture", None, max_pixels, _add_blob(blobs, data)]  # older versions stored a name in place of None


def _add_blob(blobs: Blobs, data: bytes | memoryview) -> bytes:
    digest = hashlib.sha256(data).digest()
    blobs[digest] = data
    return digest


class PartDecoder:
    """Decodes parts. Equal materials, meshes and arrays become one object."""

    def __init__(self, blob: Callable[[bytes], bytes]) -> None:
        """
        Args:
            blob: Returns the blob with a digest. Raises KeyError if there is none.
        """
        self._blob = blob
        self._shared_values: dict[bytes, Any] = {}
        self._arrays: dict[tuple[str, tuple[int, ...], bytes], NDArray[Any]] = {}

    def decode(self, data: bytes) -> tuple[Part, ...]:
        """Decode parts.

        Raises:
            DamagedError: The bytes are invalid, or a blob is missing or does not match its digest.
        """
        try:
            parts = tuple(map(self._value, msgspec.msgpack.decode(data, type=list[Any])))
        except (msgspec.DecodeError, ImageError, AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
            raise DamagedError(f"geometry cannot be read: {type(error).__name__}: {error}") from error
        if not all(isinstance(part, Part) for part in parts):
            raise DamagedError("geometry cannot be read: an entry is not a part")
        return parts

    def _value(self, value: Any) -> Any:
        if not isinstance(value, list):
            return value
        match value:
            case ["value", name, fields]:
                return CLASSES[name](**{field: self._value(each) for field, each in fields.items()})
            case ["tuple", values]:
                return tuple(map(self._value, values))
            case ["once", data]:
                return self._shared(data)
            case ["array", dtype, shape, data]:
                return _inline_array(dtype, shape, data)
            case ["blob", dtype, shape, digest]:
                return self._blob_array(dtype, shape, digest)
            case ["map", entries]:
                return MappingProxyType({self._value(key): self._value(each) for key, each in entries})
            case ["enum", name, each]:
                return _ENUMS[name](each)
            case ["text", data]:
                return data.decode("utf-8", "surrogatepass")
            case ["picture", _, max_pixels, digest]:
                return image_from_bytes(self._verified_blob(digest), max_pixels=max_pixels)
        raise DamagedError(f"a list of {len(value)} values has no known tag")

    def _shared(self, data: bytes) -> Any:
        value = self._shared_values.get(data)
        if value is None:
            value = self._shared_values[data] = self._value(msgspec.msgpack.decode(data))
        return value

    def _blob_array(self, dtype: str, shape: list[int], digest: bytes) -> NDArray[Any]:
        key = (dtype, tuple(shape), digest)
        array = self._arrays.get(key)
        if array is None:
            array = self._arrays[key] = _inline_array(dtype, shape, self._verified_blob(digest))
        return array

    def _verified_blob(self, digest: bytes) -> bytes:
        data = self._blob(digest)
        if hashlib.sha256(data).digest() != digest:
            raise DamagedError("a blob does not match its digest")
        return data


def _inline_array(dtype: str, shape: list[int], data: bytes) -> NDArray[Any]:
    if dtype == "<f8" and data == _IDENTITY and shape == [4, 4]:
        return IDENTITY
    element_type = np.dtype(dtype)
    if element_type.kind not in _ARRAY_KINDS or element_type.itemsize * math.prod(shape) != len(data):
        raise DamagedError(f"an array of {dtype} with the shape {shape} has {len(data)} bytes")
    return np.ndarray(shape, element_type, data)
