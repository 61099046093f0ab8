"""Accessors as arrays: views of the buffer where the layout allows, checked against it before anything is made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gateway.scene.gltf.buffers import Buffers
from gateway.scene.gltf.cache import Buffer
from gateway.scene.gltf.document import Document, Sparse
from gateway.scene.gltf.errors import GltfError, element
from gateway.scene.gltf.limits import GltfLimits

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


@dataclass(slots=True, eq=False)  # not frozen: that would make it three times as slow to create
class Accessor:
    """A checked accessor, not read yet. Immutable."""

    name: str
    """``accessors[3]``, for messages."""
    dtype: np.dtype[Any]
    components: int
    count: int
    normalized: bool
    buffer: Buffer | None
    """None: zeros."""
    offset: int
    """Bytes from the start of the buffer."""
    stride: int
    sparse: SparsePart | None

    @property
    def key(self) -> tuple[object, ...]:
        """Equal keys are equal contents."""
        uid = self.buffer.uid if self.buffer is not None else 0
        sparse = self.sparse.key if self.sparse is not None else None
        layout = (self.dtype.char, self.components, self.count, self.normalized)
        return (uid, self.offset, self.stride, *layout, sparse)

    @property
    def buffers(self) -> list[Buffer]:
        """What it is made of."""
        parts = (self, self.sparse.indices, self.sparse.values) if self.sparse is not None else (self,)
        return [part.buffer for part in parts if part.buffer is not None]

    def raw(self, first: int = 0, stop: int | None = None) -> Array:
        """(stop - first, components) as stored, little-endian, a view of the buffer if there is no sparse part."""
        stop = self.count if stop is None else stop
        if self.buffer is None:
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
        if self.normalized:
            result *= np.float32(1.0 / np.iinfo(self.dtype).max)
            if kind == "i":
                np.maximum(result, np.float32(-1.0), out=result)
        return result


@dataclass(frozen=True, slots=True, eq=False)
class SparsePart:
    """Elements that replace some of the accessor's."""

    indices: Accessor
    values: Accessor

    @property
    def key(self) -> tuple[object, ...]:
        return (*self.indices.key, *self.values.key)


def own(array: Array, dtype: type[np.generic]) -> Array:
    """``array`` in native order, C-contiguous and aligned; itself if it is so already."""
    result = np.ascontiguousarray(array, dtype=np.dtype(dtype))
    return result if result.flags.aligned else result.copy()


class Accessors:
    """The accessors of one document."""

    def __init__(
        self, document: Document, buffers: Buffers, limits: GltfLimits, warnings: list[str], *, merged: bool = False
    ) -> None:
        """``merged``: by Drake's client, which leaves the indices of sparse parts as they were in the single files."""
        self._document = document
        self._warnings = warnings
        self._merged = merged
        self._buffers = buffers
        self._limit = max(limits.max_vertices, limits.max_elements) * 3
        self._known: dict[int, Accessor] = {}

    def get(self, index: object, where: str) -> Accessor:
        """``accessors[index]``, its bytes checked against the buffer.

        Raises:
            GltfError: out of range, of an unknown type, or beyond its buffer view.
        """
        known = self._known.get(index) if isinstance(index, int) else None
        if known is not None:
            return known
        if type(index) is int and (plain := self._plain(index)) is not None:
            self._known[index] = plain
            return plain
        source = element(self._document.accessors, index, "accessors", where)
        assert isinstance(index, int)
        name = f"accessors[{index}]"
        dtype = _dtype(source.component_type, f"{name}.componentType")
        components = COMPONENTS.get(source.type or "")
        if components is None:
            raise GltfError(f"{name}.type: {str(source.type)[:20]} is not one of {', '.join(COMPONENTS)}")
        count = _count(source.count, self._limit, f"{name}.count")
        accessor = self._accessor(
            name, source.buffer_view, source.byte_offset, dtype, components, count, bool(source.normalized)
        )
        if source.sparse is not None:
            try:
                accessor = self._with_sparse(accessor, source.sparse)
            except GltfError as error:
                if not self._merged:
                    raise
                self._warnings.append(f"{error} (Drake's merge does not adapt sparse accessors: ignored)")
        self._known[index] = accessor
        return accessor

    def _plain(self, index: int) -> Accessor | None:
        """The accessor if it is as nearly all are: tight, not sparse, without a fault. Documents have thousands, and
        most of the other way's time goes into names for messages. None: the other way finds out what is wrong."""
        accessors, views = self._document.accessors, self._document.buffer_views
        if accessors is None or views is None or not 0 <= index < len(accessors):
            return None
        source = accessors[index]
        if source is None or source.sparse is not None or source.count is None or source.buffer_view is None:
            return None
        dtype, components = COMPONENT_TYPES.get(source.component_type or 0), COMPONENTS.get(source.type or "")
        if dtype is None or components is None or not 0 <= source.count <= self._limit:
            return None
        view = views[source.buffer_view] if 0 <= source.buffer_view < len(views) else None
        if view is None or view.extensions or view.byte_stride is not None or view.buffer is None:
            return None
        buffer = self._buffers.load(view.buffer, f"bufferViews[{source.buffer_view}].buffer")
        start, length, offset = view.byte_offset or 0, view.byte_length, source.byte_offset or 0
        stride = dtype.itemsize * components
        if length is None or start < 0 or length < 0 or offset < 0 or start + length > len(buffer.data):
            return None
        if offset + source.count * stride > length:
            return None
        normalized = bool(source.normalized)
        return Accessor(
            f"accessors[{index}]", dtype, components, source.count, normalized, buffer, start + offset, stride, None
        )

    def _accessor(
        self,
        name: str,
        view: int | None,
        byte_offset: int | None,
        dtype: np.dtype[Any],
        components: int,
        count: int,
        normalized: bool = False,
    ) -> Accessor:
        if view is None:
            return Accessor(name, dtype, components, count, normalized, None, 0, 0, None)
        buffer, start, length, view_stride = self._buffers.view(view, f"{name}.bufferView")
        size = dtype.itemsize * components
        stride = view_stride or size
        offset = byte_offset or 0
        if not size <= stride <= max(_MAX_STRIDE, size):
            raise GltfError(f"bufferViews[{view}].byteStride: {stride} is not between {size} and {_MAX_STRIDE}")
        needed = offset + (count - 1) * stride + size if count else 0
        if offset < 0 or needed > length:
            raise GltfError(f"{name}: needs {needed} bytes of bufferViews[{view}], which has {length}")
        return Accessor(name, dtype, components, count, normalized, buffer, start + offset, stride, None)

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
        indices = self._accessor(
            f"{name}.indices", sparse.indices.buffer_view, sparse.indices.byte_offset, dtype, 1, count
        )
        values = self._accessor(
            f"{name}.values", sparse.values.buffer_view, sparse.values.byte_offset, base.dtype, base.components, count
        )
        if (largest := int(indices.raw().max())) >= base.count:
            raise GltfError(f"{name}.indices: {largest} is out of range ({base.count} elements)")
        return replace(base, sparse=SparsePart(indices, values))


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
