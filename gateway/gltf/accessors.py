"""Accessors as arrays: views of the buffer where the layout allows, checked against it before anything is made."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from itertools import product
from typing import Any, Final, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.gltf.buffers import Buffers
from gateway.gltf.content_cache import Buffer
from gateway.gltf.document import Document, Sparse
from gateway.gltf.errors import GltfError, element
from gateway.gltf.limits import GltfLimits
from renderers.stop import check_stop

Array: TypeAlias = NDArray[Any]

COMPONENT_TYPES: Final[dict[int, np.dtype[Any]]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5124: np.dtype("<i4"),  # not in the specification, but in files
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
    5130: np.dtype("<f8"),  # KHR_accessor_float64
}
COMPONENTS: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_MAX_STRIDE: Final = 252
"""Bytes, by the specification; zero would make a huge array of few bytes."""


_pack_key: Final = struct.Struct("=5q").pack
KEY: Final = 40
"""Bytes of a key: buffer, offset, stride, count, kind. Bytes remember their hash, tuples do not."""
ZEROS: Final = Buffer(b"", 0)
"""Of accessors without a buffer view."""


class Kind(msgspec.Struct, frozen=True, gc=False, eq=False):
    """What the values of an accessor are; equal ones are one object."""

    dtype: np.dtype[Any]
    components: int
    normalized: bool
    nbytes: int
    """Of all components together."""
    code: int
    """From 1 on; in keys."""
    scale: float
    """Of integers that are normalized: float32, what their largest value is multiplied by to become 1; else 1."""


def _scale(dtype: np.dtype[Any]) -> float:
    return 1.0 if dtype.kind == "f" else float(np.float32(1.0 / np.iinfo(dtype).max))


_KINDS: Final[dict[tuple[int | None, str | None, bool | None], Kind]] = {
    (code, shape, normalized): Kind(
        dtype, components, normalized, dtype.itemsize * components, number, _scale(dtype) if normalized else 1.0
    )
    for number, (code, shape, normalized) in enumerate(product(COMPONENT_TYPES, COMPONENTS, (False, True)), 1)
    for dtype, components in ((COMPONENT_TYPES[code], COMPONENTS[shape]),)
}
KINDS: Final = frozenset(_KINDS.values())
_BY_SAID: Final[dict[tuple[int | None, str | None, bool | None], Kind]] = {
    **_KINDS,
    **{(code, shape, None): kind for (code, shape, normalized), kind in _KINDS.items() if not normalized},
}
POINTS: Final = _KINDS[5126, "VEC3", False]
TEXTURE_COORDINATES: Final = _KINDS[5126, "VEC2", False]
INDICES: Final = frozenset(_KINDS[code, "SCALAR", False] for code in (5121, 5123, 5125))
ALIGNED_INDICES: Final = _KINDS[5125, "SCALAR", False]


class Accessor(msgspec.Struct, frozen=True, gc=False, eq=False):
    """A checked accessor, not read yet."""

    index: int
    kind: Kind
    count: int
    buffer: Buffer
    """``ZEROS``: there is none."""
    offset: int
    """Bytes from the start of the buffer."""
    stride: int
    sparse: SparsePart | None = None
    part: str = ""
    """``.sparse.indices`` of the accessor, for messages."""

    @property
    def name(self) -> str:
        """``accessors[3]``, for messages."""
        return f"accessors[{self.index}]{self.part}"

    @property
    def key(self) -> bytes:
        """Equal keys are equal contents; of ``KEY`` bytes, longer with a sparse part."""
        own = _pack_key(self.buffer.uid, self.offset, self.stride, self.count, self.kind.code)
        return own if self.sparse is None else own + self.sparse.indices.key + self.sparse.values.key

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.kind.dtype

    @property
    def components(self) -> int:
        return self.kind.components

    @property
    def buffers(self) -> list[Buffer]:
        """What it is made of."""
        parts = (self, self.sparse.indices, self.sparse.values) if self.sparse is not None else (self,)
        return [part.buffer for part in parts if part.buffer is not ZEROS]

    def raw(self, first: int = 0, stop: int | None = None) -> Array:
        """(stop - first, components) as stored, little-endian, a view of the buffer if there is no sparse part."""
        stop = self.count if stop is None else stop
        if self.buffer is ZEROS:
            array: Array = np.zeros((stop - first, self.components), self.dtype)
        else:
            array = np.ndarray(
                (stop - first, self.components),
                self.dtype,
                self.buffer.data,
                self.offset + first * self.stride if stop > first else 0,
                (self.stride, self.dtype.itemsize),
            )
        if self.sparse is None:
            return array
        indices, values = self.sparse.indices.raw()[:, 0], self.sparse.values.raw()
        array = array.copy()
        wanted = (indices >= first) & (indices < stop)
        array[indices[wanted].astype(np.int64) - first] = values[wanted]
        return array

    def floats(self, first: int = 0, stop: int | None = None) -> NDArray[np.float32]:
        """(stop - first, components) float32, C-contiguous and aligned, integers normalised if the accessor says so."""
        array = self.raw(first, stop)
        kind = self.dtype.kind
        if self.dtype == np.float32:
            return own(array, np.float32)
        if kind == "f":
            with np.errstate(over="ignore", invalid="ignore"):
                return own(array, np.float32)
        result = array.astype(np.float32, order="C")
        if self.kind.normalized:
            result *= np.float32(self.kind.scale)
            if kind == "i":
                np.maximum(result, np.float32(-1.0), out=result)
        return result


class SparsePart(msgspec.Struct, frozen=True, gc=False, eq=False):
    """Elements that replace some of the accessor's."""

    indices: Accessor
    values: Accessor


NOTHING: Final = Accessor(-1, POINTS, 0, ZEROS, 0, 0)
"""Stands in keys for one that there is not."""


def one_after_the_other(count: int) -> Accessor:
    """Stands for the indices of a primitive that has none."""
    return Accessor(-1, ALIGNED_INDICES, count, ZEROS, 0, ALIGNED_INDICES.nbytes)


def own(array: Array, dtype: type[np.generic]) -> Array:
    """``array`` in native order, C-contiguous and aligned; itself if it is so already."""
    result = np.ascontiguousarray(array, dtype=np.dtype(dtype))
    return result if result.flags.aligned else result.copy()


class Accessors:
    """The accessors of one document."""

    def __init__(
        self,
        document: Document,
        buffers: Buffers,
        limits: GltfLimits,
        warnings: list[str],
        *,
        merged: bool = False,
    ) -> None:
        """
        Args:
            merged: by Drake's client, which leaves the indices of sparse parts as they were in the single files.
        """
        self._document = document
        self._sources = document.accessors or []
        self._views = document.buffer_views or []
        self._warnings = warnings
        self._merged = merged
        self._buffers = buffers
        self._loaded = buffers.loaded
        self._limit = max(limits.max_vertices, limits.max_elements) * 3
        self.known: dict[int, Accessor] = {}
        """What ``prepare`` found."""
        self._others: dict[int, Accessor] = {}

    def get(self, index: object, where: str) -> Accessor:
        """``accessors[index]``, its bytes checked against the buffer.

        Raises:
            GltfError: out of range, of an unknown type, or beyond its buffer view.
        """
        if type(index) is int:
            self.prepare((index,))
            if (known := self.known.get(index) or self._others.get(index)) is not None:
                return known
        check_stop()
        source = element(self._document.accessors, index, "accessors", where)
        assert isinstance(index, int)
        name = f"accessors[{index}]"
        _dtype(source.component_type, f"{name}.componentType")
        kind = _KINDS.get((source.component_type, source.type, bool(source.normalized)))
        if kind is None:
            raise GltfError(f"{name}.type: {str(source.type)[:20]} is not one of {', '.join(COMPONENTS)}")
        count = _count(source.count, self._limit, f"{name}.count")
        accessor = self._accessor(index, source.buffer_view, source.byte_offset, kind, count)
        if source.sparse is not None:
            try:
                accessor = self._with_sparse(accessor, source.sparse)
            except GltfError as error:
                if not self._merged:
                    raise
                self._warnings.append(f"{error} (Drake's merge does not adapt sparse accessors: ignored)")
        self._others[index] = accessor
        return accessor

    def prepare(self, indices: Iterable[int]) -> None:
        """Finds those that are as nearly all are: not sparse, without a fault. They are ``known`` then; ``get`` finds
        out what the others are. Documents have thousands, and most of its time goes into messages."""
        sources, views, limit, loaded, known = self._sources, self._views, self._limit, self._loaded, self.known
        last, last_view, said = len(sources) - 1, len(views) - 1, _BY_SAID.get
        found: list[tuple[int, Kind, int, int, int, int, int, int]] = []
        missing: dict[int, None] = {}
        for index in indices:
            source = sources[index] if 0 <= index <= last else None
            if source is None or source.sparse is not None or index in known:
                continue
            kind = said((source.component_type, source.type, source.normalized))
            count, at = source.count, source.buffer_view
            if kind is None or count is None or at is None or not 0 <= count <= limit or not 0 <= at <= last_view:
                continue
            view, size = views[at], kind.nbytes
            if view is None or view.buffer is None or view.extensions:
                continue
            stride = view.byte_stride or size
            start, length, offset = view.byte_offset or 0, view.byte_length, source.byte_offset or 0
            if length is None or length < 0 or start < 0 or offset < 0:
                continue
            if stride != size and not size <= stride <= _MAX_STRIDE:
                continue
            if offset > length or (count and offset + (count - 1) * stride + size > length):
                continue
            found.append((index, kind, count, view.buffer, at, start + offset, start + length, stride))
            if view.buffer not in loaded:
                missing[view.buffer] = None
        if missing:
            self._buffers.load_together(missing)
        for index, kind, count, of, at, start, end, stride in found:
            buffer = loaded.get(of)
            if buffer is None:
                try:
                    buffer = self._buffers.load(of, at)
                except GltfError:
                    continue  # who asks for it is told
            if end <= len(buffer.data):
                known[index] = Accessor(index, kind, count, buffer, start, stride)

    def _accessor(
        self, index: int, view: int | None, byte_offset: int | None, kind: Kind, count: int, part: str = ""
    ) -> Accessor:
        if view is None:
            return Accessor(index, kind, count, ZEROS, 0, 0, None, part)
        name = f"accessors[{index}]{part}"
        buffer, start, length, view_stride = self._buffers.view(view, f"{name}.bufferView")
        size = kind.nbytes
        stride = view_stride or size
        offset = byte_offset or 0
        if not size <= stride <= max(_MAX_STRIDE, size):
            raise GltfError(f"bufferViews[{view}].byteStride: {stride} is not between {size} and {_MAX_STRIDE}")
        needed = offset + (count - 1) * stride + size if count else offset
        if offset < 0 or needed > length:
            raise GltfError(f"{name}: needs {needed} bytes of bufferViews[{view}], which has {length}")
        return Accessor(index, kind, count, buffer, start + offset, stride, None, part)

    def _with_sparse(self, base: Accessor, sparse: Sparse) -> Accessor:
        name = f"{base.name}.sparse"
        count = _count(sparse.count, base.count, f"{name}.count")
        if count == 0:
            return base
        if sparse.indices is None or sparse.values is None:
            raise GltfError(f"{name}: indices or values are missing")
        if sparse.indices.buffer_view is None or sparse.values.buffer_view is None:
            raise GltfError(f"{name}: the bufferView of indices or values is missing")
        dtype = _dtype(sparse.indices.component_type, f"{name}.indices.componentType")
        if dtype.kind != "u":
            raise GltfError(f"{name}.indices.componentType: {sparse.indices.component_type} is not unsigned")
        kind = _KINDS[sparse.indices.component_type or 0, "SCALAR", False]
        indices = self._accessor(
            base.index, sparse.indices.buffer_view, sparse.indices.byte_offset, kind, count, ".sparse.indices"
        )
        values = self._accessor(
            base.index, sparse.values.buffer_view, sparse.values.byte_offset, base.kind, count, ".sparse.values"
        )
        if (largest := int(indices.raw().max())) >= base.count:
            raise GltfError(f"{name}.indices: {largest} is out of range ({base.count} elements)")
        return msgspec.structs.replace(base, sparse=SparsePart(indices, values))


def _dtype(component_type: int | None, where: str) -> np.dtype[Any]:
    dtype = COMPONENT_TYPES.get(component_type or 0)
    if dtype is None:
        raise GltfError(f"{where}: {component_type} is not a component type")
    return dtype


def _count(count: int | None, limit: int, where: str) -> int:
    if count is None:
        raise GltfError(f"{where}: missing")
    if not 0 <= count <= limit:
        raise GltfError(f"{where}: {count} is not between 0 and {limit}")
    return count
