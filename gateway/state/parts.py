"""Geometry as bytes and back, exactly: MessagePack for the structure, arrays and encoded pictures as blobs beside it.

A value that MessagePack has (None, bool, int, float, bytes, text that is UTF-8) stands for itself, everything else is a
list whose first entry says what it is::

    ["text", UTF-8 with surrogates]          ["tuple", values]            ["map", {name: value}]
    ["value", class, {field: value}]         ["enum", class, value]       ["once", the bytes of a value]
    ["array", dtype, shape, bytes]           ["blob", dtype, shape, sha256]
    ["picture", name, most pixels, sha256]

``once`` is written for what many parts share (materials, meshes): equal bytes become one object again.
"""

from __future__ import annotations

import hashlib
import math
import weakref
from collections.abc import Callable, Hashable, Mapping
from dataclasses import fields
from enum import Enum
from types import MappingProxyType
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.scene import geometry
from gateway.scene.geometry import Part
from gateway.scene.transforms import IDENTITY
from renderers.drawlist import AlphaMode, Image, ImageError, Material, Mesh, Sampler, Texture, Wrap
from renderers.encode import png_rgba
from renderers.images import image_from_bytes

INLINE_BYTES: Final = 256
"""Smaller arrays stand in the structure: a blob of its own costs as much."""
_REMEMBERED: Final = 4096
"""Shared values whose bytes are remembered while they live."""
_VALUES: Final[Mapping[str, type[Any]]] = MappingProxyType(
    {
        kind.__name__: kind
        for kind in (
            *(geometry.Box, geometry.Sphere, geometry.Ellipsoid, geometry.Cylinder, geometry.Capsule),
            *(geometry.Surface, geometry.PointCloud, geometry.Triad, geometry.Line, Part),
            *(Material, Mesh, Sampler, Texture),
        )
    }
)
_ENUMS: Final[Mapping[str, type[Enum]]] = MappingProxyType({kind.__name__: kind for kind in (AlphaMode, Wrap)})
_FIELDS: Final[Mapping[type[Any], tuple[str, ...]]] = {
    kind: kind.__struct_fields__ if issubclass(kind, msgspec.Struct) else tuple(field.name for field in fields(kind))
    for kind in _VALUES.values()
}
_PLAIN: Final = frozenset((geometry.Box, geometry.Sphere, geometry.Ellipsoid, geometry.Cylinder, geometry.Capsule))
"""Shapes of a few numbers, which clients send by the thousand."""
_SHARED: Final = (Material, Mesh)
_KINDS: Final = frozenset("fiub")
"""Kinds of array elements: numbers and truth values, never objects."""
_IDENTITY: Final = IDENTITY.tobytes()

Blobs = dict[bytes, "bytes | memoryview"]
"""By digest."""
_encoder: Final = msgspec.msgpack.Encoder()


class DamagedError(ValueError):
    """The bytes are not geometry as this module writes it."""


class PartsWriter:
    """Makes bytes of geometry. Belongs to one thread; remembers digests while their values live."""

    def __init__(self) -> None:
        self._digests: dict[int, tuple[weakref.ref[Any], bytes]] = {}
        self._shared: dict[int, tuple[Any, bytes, Blobs]] = {}

    def alike(self, parts: tuple[Part, ...]) -> Hashable | None:
        """Equal for parts of the same bytes, as long as their materials live; None: only ``encode`` can tell.

        Numbers are compared as they are stored: 1 and 1.0, 0.0 and -0.0 differ.
        """
        key = []
        for part in parts:
            if type(part.shape) not in _PLAIN or part.X_node_part is not IDENTITY:
                return None
            key.append((type(part.shape), _encoder.encode(part.shape), id(part.material), part.kind, part.source))
        return tuple(key)

    def encode(self, parts: tuple[Part, ...]) -> tuple[bytes, Blobs]:
        """The structure, and the blobs that it names; arrays are not copied."""
        blobs: Blobs = {}
        return _encoder.encode([self._value(part, blobs) for part in parts]), blobs

    def _value(self, value: Any, blobs: Blobs) -> Any:
        kind = type(value)
        if value is None or kind in (bool, int, float, bytes):
            return value
        if kind is str:
            try:
                value.encode()
            except UnicodeEncodeError:
                return ["text", value.encode("utf-8", "surrogatepass")]
            return value
        if kind in _SHARED:
            return ["once", self._once(value, blobs)]
        if kind in _FIELDS:
            return self._fields(value, blobs)
        if isinstance(value, np.ndarray):
            return self._array(value, blobs)
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, Enum):
            return ["enum", kind.__name__, value.value]
        if isinstance(value, tuple):
            return ["tuple", [self._value(entry, blobs) for entry in value]]
        if isinstance(value, Mapping):
            return ["map", [[self._value(k, blobs), self._value(v, blobs)] for k, v in value.items()]]
        if isinstance(value, Image):
            return self._picture(value, blobs)
        raise TypeError(f"geometry with a {kind.__name__} cannot be stored")

    def _fields(self, value: Any, blobs: Blobs) -> list[Any]:
        kind = type(value)
        return ["value", kind.__name__, {name: self._value(getattr(value, name), blobs) for name in _FIELDS[kind]}]

    def _once(self, value: Any, blobs: Blobs) -> bytes:
        known = self._shared.get(id(value))
        if known is None:
            named: Blobs = {}
            # A mesh's arrays must not be kept alive by what is remembered; their digests are remembered anyway.
            if isinstance(value, Mesh):
                data = _encoder.encode(self._fields(value, named))
                blobs.update(named)
                return data
            known = (value, _encoder.encode(self._fields(value, named)), named)
            if len(self._shared) >= _REMEMBERED:
                self._shared.clear()
            if not named:
                self._shared[id(value)] = known
        blobs.update(known[2])
        return known[1]

    def _array(self, array: NDArray[Any], blobs: Blobs) -> list[Any]:
        if array.dtype.kind not in _KINDS:
            raise TypeError(f"an array of {array.dtype} cannot be stored")
        dtype, shape = array.dtype.str, list(array.shape)
        if array.nbytes <= INLINE_BYTES:
            return ["array", dtype, shape, array.tobytes()]
        whole = np.ascontiguousarray(array)
        raw = whole.reshape(-1).view(np.uint8).data
        digest = self._digest(array, raw)
        blobs[digest] = raw
        return ["blob", dtype, shape, digest]

    def _digest(self, array: NDArray[Any], raw: memoryview) -> bytes:
        key = id(array)
        known = self._digests.get(key)
        if known is not None and known[0]() is array:
            return known[1]
        digest = hashlib.sha256(raw).digest()
        self._digests[key] = (weakref.ref(array, lambda _: self._digests.pop(key, None)), digest)
        return digest

    def _picture(self, image: Image, blobs: Blobs) -> list[Any]:
        data, most = getattr(image.decode, "data", None), getattr(image.decode, "max_pixels", None)
        if data is None or most is None:  # not of a file: its pixels are what it is
            pixels = image.decode()
            data, most = png_rgba(pixels), max(1, pixels.shape[0] * pixels.shape[1])
        digest = hashlib.sha256(data).digest()
        blobs[digest] = data
        return ["picture", None, most, digest]  # names belong to textures; files of before have one here


class PartsReader:
    """Makes geometry of bytes; equal content becomes one object."""

    def __init__(self, blob: Callable[[bytes], bytes]) -> None:
        """``blob``: the blob with a digest; raises KeyError when there is none."""
        self._blob = blob
        self._once: dict[bytes, Any] = {}
        self._arrays: dict[tuple[str, tuple[int, ...], bytes], NDArray[Any]] = {}

    def decode(self, data: bytes) -> tuple[Part, ...]:
        """The parts.

        Raises:
            DamagedError: the bytes, or a blob that they name, are not what they were.
        """
        try:
            return tuple(self._part(entry) for entry in msgspec.msgpack.decode(data, type=list[Any]))
        except (msgspec.DecodeError, ImageError, KeyError, TypeError, ValueError, IndexError) as error:
            raise DamagedError(f"geometry cannot be read: {type(error).__name__}: {error}") from error

    def _part(self, entry: Any) -> Part:
        part = self._value(entry)
        if not isinstance(part, Part):
            raise DamagedError("an entry is no geometry")
        return part

    def _value(self, value: Any) -> Any:
        if not isinstance(value, list):
            return value
        return _READERS[value[0]](self, *value[1:])

    def _text(self, data: bytes) -> str:
        return data.decode("utf-8", "surrogatepass")

    def _tuple(self, values: list[Any]) -> tuple[Any, ...]:
        return tuple(self._value(value) for value in values)

    def _map(self, entries: list[list[Any]]) -> Mapping[Any, Any]:
        return MappingProxyType({self._value(key): self._value(value) for key, value in entries})

    def _dataclass(self, name: str, values: dict[str, Any]) -> Any:
        return _VALUES[name](**{field: self._value(value) for field, value in values.items()})

    def _enum(self, name: str, value: Any) -> Enum:
        return _ENUMS[name](value)

    def _shared(self, data: bytes) -> Any:
        known = self._once.get(data)
        if known is None:
            known = self._once[data] = self._value(msgspec.msgpack.decode(data))
        return known

    def _inline(self, dtype: str, shape: list[int], data: bytes) -> NDArray[Any]:
        if dtype == "<f8" and data == _IDENTITY and shape == [4, 4]:
            return IDENTITY
        kind = np.dtype(dtype)
        if kind.kind not in _KINDS or kind.itemsize * math.prod(shape) != len(data):
            raise DamagedError(f"an array of {dtype} with the shape {shape} has {len(data)} bytes")
        return np.ndarray(shape, kind, data)

    def _outside(self, dtype: str, shape: list[int], digest: bytes) -> NDArray[Any]:
        key = (dtype, tuple(shape), digest)
        known = self._arrays.get(key)
        if known is None:
            known = self._arrays[key] = self._inline(dtype, shape, self._checked(digest))
        return known

    def _picture(self, _: Any, most: int, digest: bytes) -> Image:
        return image_from_bytes(self._checked(digest), max_pixels=most)

    def _checked(self, digest: bytes) -> bytes:
        data = self._blob(digest)
        if hashlib.sha256(data).digest() != digest:
            raise DamagedError("a blob is not what its digest says")
        return data


_READERS: Final[Mapping[str, Callable[..., Any]]] = MappingProxyType(
    {
        "text": PartsReader._text,
        "tuple": PartsReader._tuple,
        "map": PartsReader._map,
        "value": PartsReader._dataclass,
        "enum": PartsReader._enum,
        "once": PartsReader._shared,
        "array": PartsReader._inline,
        "blob": PartsReader._outside,
        "picture": PartsReader._picture,
    }
)
