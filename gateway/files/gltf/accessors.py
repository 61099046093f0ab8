"""Accessors: typed arrays in buffer views. Their size is checked against the buffer before memory is allocated."""

from __future__ import annotations

from contextlib import nullcontext
from struct import Struct
from typing import Any, Final, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.files.gltf.buffers import Buffer, Buffers
from gateway.files.gltf.gltf_errors import GltfError, GltfLimits, as_warning, checked_item
from gateway.files.gltf.schema import Document, Sparse

Array: TypeAlias = NDArray[Any]

COMPONENT_TYPES: Final[dict[int | None, np.dtype[Any]]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5124: np.dtype("<i4"),  # not in the specification, but in files
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
    5130: np.dtype("<f8"),  # KHR_accessor_float64
}
"""Data types by ``componentType``."""
COMPONENT_COUNTS: Final[dict[str | None, int]] = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
"""Number of components by ``type``. MAT2 and MAT3 are missing: the specification uses them for nothing."""
_MAX_STRIDE: Final = 252
"""Maximum ``byteStride`` in bytes, by the specification."""
_pack_key: Final = Struct("<B32s3qc??").pack
_NO_BUFFER: Final = bytes(32)
"""Digest in the key of an accessor without a buffer."""


class Accessor(msgspec.Struct, frozen=True, gc=False, eq=False):
    """An accessor after validation: all of its values lie within its buffer."""

    name: str
    """``accessors[3]`` or ``accessors[3].sparse.indices``, for messages."""
    dtype: np.dtype[Any]
    components: int
    """Number of components of a value: 1 .. 4, or 16 for a matrix."""
    normalized: bool
    """True if integers stand for 0 .. 1 or -1 .. 1."""
    count: int
    """Number of values."""
    buffer: Buffer | None
    """None: all values are zero, except those of the sparse part."""
    offset: int
    """Bytes from the start of the buffer."""
    stride: int
    """Bytes from one value to the next."""
    sparse: tuple[Accessor, Accessor] | None = None
    """Indices and values that replace some of the accessor's values."""

    @property
    def is_stored(self) -> bool:
        """False if the file has no values for it; they are all zero, or in Draco data."""
        return self.buffer is not None or self.sparse is not None

    @property
    def key(self) -> bytes:
        """Identifies the content: accessors with equal keys have equal values.

        A key's first part says whether a sparse part follows. No key is therefore the start of another key, and a
        concatenation of keys identifies all of them.
        """
        key = _pack_key(
            self.components,  # never 0, unlike the key of an absent accessor
            _NO_BUFFER if self.buffer is None else self.buffer.digest,
            self.offset,
            self.stride,
            self.count,
            self.dtype.char.encode(),
            self.normalized,
            self.sparse is not None,
        )
        return key if self.sparse is None else key + self.sparse[0].key + self.sparse[1].key

    def values(self, begin: int = 0, end: int | None = None) -> Array:
        """Return the values from ``begin`` to before ``end`` (None: to the last) as stored, (end - begin, components).

        A view of the buffer, or a copy if there is a sparse part.
        """
        end = self.count if end is None else end
        shape = (end - begin, self.components)
        if self.buffer is None:
            array: Array = np.zeros(shape, self.dtype)
        else:
            offset = self.offset + begin * self.stride if end > begin else 0
            strides = (self.stride, self.dtype.itemsize)
            array = np.ndarray(shape, self.dtype, self.buffer.data, offset, strides)
        if self.sparse is None:
            return array
        indices, values = self.sparse[0].values()[:, 0], self.sparse[1].values()
        within = (indices >= begin) & (indices < end)
        array = array.copy()
        array[indices[within].astype(np.int64) - begin] = values[within]
        return array

    def floats(self, begin: int = 0, end: int | None = None) -> NDArray[np.float32]:
        """Return a copy of ``values`` as float32, C-contiguous; normalized integers are in 0 .. 1 or -1 .. 1."""
        values = self.values(begin, end)
        if self.dtype.char == "d":
            with np.errstate(over="ignore", invalid="ignore"):
                return values.astype(np.float32, order="C")
        result = values.astype(np.float32, order="C")
        if self.normalized and self.dtype.kind in "iu":
            result *= np.float32(1.0 / np.iinfo(self.dtype).max)
            if self.dtype.kind == "i":
                np.maximum(result, np.float32(-1.0), out=result)
        return result


class Accessors:
    """The accessors of one document, each checked at its first use."""

    def __init__(self, document: Document, buffers: Buffers, limits: GltfLimits, warnings: list[str]) -> None:
        self._sources = document.accessors
        self._buffers = buffers
        self._max_count = max(limits.max_vertices, limits.max_elements) * 3  # a triangle has three indices
        self._warnings = warnings
        self._merged_by_drake = document.merged_by_drake
        self._accessors: dict[int, Accessor] = {}

    def get(self, index: int, path: str) -> Accessor:
        """Return ``accessors[index]``, named by the property ``path``. Raises GltfError: none, or beyond its view."""
        if (checked := self._accessors.get(index)) is not None:
            return checked
        source = checked_item(self._sources, index, "accessors", path)
        name = f"accessors[{index}]"
        dtype = _checked_dtype(source.component_type, name)
        components = COMPONENT_COUNTS.get(source.type)
        if components is None:
            raise GltfError(
                f"{name}.type: {str(source.type)[:20]} is not one of {', '.join(map(str, COMPONENT_COUNTS))}"
            )
        count = _checked_count(source.count, self._max_count, f"{name}.count")
        location = self._locate(name, source.buffer_view, source.byte_offset, dtype.itemsize * components, count)
        accessor = Accessor(name, dtype, components, bool(source.normalized), count, *location)
        if source.sparse is not None:
            ignored = "ignored, as Drake's merge does not adapt sparse accessors"
            with as_warning(self._warnings, ignored) if self._merged_by_drake else nullcontext():
                accessor = self._with_sparse(accessor, source.sparse)
        self._accessors[index] = accessor
        return accessor

    def _locate(
        self, name: str, view_index: int | None, byte_offset: int | None, size: int, count: int
    ) -> tuple[Buffer | None, int, int]:
        """Return the buffer, offset and stride in bytes of ``count`` values of ``size`` bytes each.

        Without a view (None) there is no buffer; the offset in it is 0 for None.
        """
        if view_index is None:
            return None, 0, 0
        view = self._buffers.view(view_index, f"{name}.bufferView")
        stride, offset = view.stride or size, byte_offset or 0
        if not size <= stride <= max(_MAX_STRIDE, size):
            raise GltfError(f"bufferViews[{view_index}].byteStride: {stride} is not between {size} and {_MAX_STRIDE}")
        needed = offset + (count - 1) * stride + size if count else offset
        if offset < 0 or needed > view.length:
            raise GltfError(f"{name}: needs {needed} bytes of bufferViews[{view_index}], which has {view.length}")
        return view.buffer, view.offset + offset, stride

    def _with_sparse(self, base: Accessor, sparse: Sparse) -> Accessor:
        """Return ``base`` with the sparse part checked and added."""
        name = f"{base.name}.sparse"
        count = _checked_count(sparse.count, base.count, f"{name}.count")
        if count == 0:
            return base
        if sparse.indices is None or sparse.values is None:
            raise GltfError(f"{name}: indices or values are missing")
        if sparse.indices.buffer_view is None or sparse.values.buffer_view is None:
            raise GltfError(f"{name}: the bufferView of indices or values is missing")
        dtype = _checked_dtype(sparse.indices.component_type, f"{name}.indices")
        if dtype.kind != "u":
            raise GltfError(f"{name}.indices.componentType: {sparse.indices.component_type} is not unsigned")
        location = self._locate(
            f"{name}.indices", sparse.indices.buffer_view, sparse.indices.byte_offset, dtype.itemsize, count
        )
        indices = Accessor(f"{name}.indices", dtype, 1, False, count, *location)
        size = base.dtype.itemsize * base.components
        location = self._locate(f"{name}.values", sparse.values.buffer_view, sparse.values.byte_offset, size, count)
        values = Accessor(f"{name}.values", base.dtype, base.components, base.normalized, count, *location)
        if (max_index := int(indices.values().max())) >= base.count:
            raise GltfError(f"{name}.indices: {max_index} is out of range ({base.count} elements)")
        return msgspec.structs.replace(base, sparse=(indices, values))


def _checked_dtype(component_type: int | None, name: str) -> np.dtype[Any]:
    dtype = COMPONENT_TYPES.get(component_type)
    if dtype is None:
        raise GltfError(f"{name}.componentType: {component_type} is not a component type")
    return dtype


def _checked_count(count: int | None, limit: int, path: str) -> int:
    if count is None:
        raise GltfError(f"{path}: missing")
    if not 0 <= count <= limit:
        raise GltfError(f"{path}: {count} is not between 0 and {limit}")
    return count
