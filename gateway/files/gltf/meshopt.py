"""Decompresses buffer views of KHR_meshopt_compression, and of EXT_meshopt_compression, which is a part of it."""

from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gateway.files.gltf import schema
from gateway.files.gltf.gltf_errors import GltfError
from gateway.files.gltf.meshopt_kernels import MeshoptError, decode_attributes, decode_indices, decode_triangles
from renderers.stop import check_stop

ElementBytes: TypeAlias = NDArray[np.uint8]
"""(number of elements, bytes of an element) uint8."""

EXTENSIONS: Final = ("KHR_meshopt_compression", "EXT_meshopt_compression")
MAX_ELEMENT_BYTES: Final = 256
_INDEX_DTYPES: Final[dict[int, type[np.uint16] | type[np.uint32]]] = {2: np.uint16, 4: np.uint32}
_MAX_INT16: Final = 32767
_ELEMENTS_PER_STOP_CHECK: Final = 1 << 16


def decompress(source: schema.MeshoptCompression, compressed: bytes | memoryview, path: str) -> memoryview:
    """Return the content of a buffer view: ``count * byteStride`` bytes. Raises GltfError if it is damaged."""
    count, stride = checked_layout(source, path)
    if count == 0:
        return memoryview(b"")
    stream = np.frombuffer(compressed, np.uint8)
    try:
        if source.mode == "ATTRIBUTES":
            elements = decode_attributes(stream, count, stride)
            _apply_filter(elements, source.filter, path)
            return elements.data.cast("B")
        decode = decode_triangles if source.mode == "TRIANGLES" else decode_indices
        return decode(stream, count).astype(_INDEX_DTYPES[stride]).data.cast("B")
    except MeshoptError as error:
        raise GltfError(f"{path}: {error}") from error


def checked_layout(source: schema.MeshoptCompression, path: str) -> tuple[int, int]:
    """Return ``count`` and ``byteStride`` of a buffer view. Raises GltfError unless its mode allows them."""
    count, stride = source.count, source.byte_stride
    if count is None or count < 0:
        raise GltfError(f"{path}.count: {count} is not a number of elements")
    if source.mode == "ATTRIBUTES":
        if stride is None or not 4 <= stride <= MAX_ELEMENT_BYTES or stride % 4:
            raise GltfError(f"{path}.byteStride: {stride} is not a multiple of 4 between 4 and {MAX_ELEMENT_BYTES}")
        return count, stride
    if source.mode not in ("TRIANGLES", "INDICES"):
        raise GltfError(f"{path}.mode: {str(source.mode)[:20]} is not ATTRIBUTES, TRIANGLES or INDICES")
    if stride not in _INDEX_DTYPES:
        raise GltfError(f"{path}.byteStride: {stride} is not 2 or 4")
    if source.mode == "TRIANGLES" and count % 3:
        raise GltfError(f"{path}.count: {count} is not a multiple of 3")
    return count, stride


def _apply_filter(elements: ElementBytes, filter_name: str | None, path: str) -> None:
    """Replace decoded elements by the values that a filter of the extension makes of them."""
    stride = elements.shape[1]
    values: NDArray[Any]
    if filter_name in (None, "NONE"):
        return
    if filter_name == "OCTAHEDRAL" and stride in (4, 8):
        values, decode = elements.view(np.int8 if stride == 4 else np.int16), _decode_octahedral
    elif filter_name == "QUATERNION" and stride == 8:
        values, decode = elements.view(np.int16), _decode_quaternions
    elif filter_name == "COLOR" and stride in (4, 8):
        values, decode = elements.view(np.uint8 if stride == 4 else np.uint16), _decode_colors
    elif filter_name == "EXPONENTIAL":  # of any stride: they are multiples of 4
        values, decode = elements.view(np.int32), _decode_exponential
    else:
        raise GltfError(f"{path}.filter: {str(filter_name)[:20]} is not a filter for a byteStride of {stride}")
    for begin in range(0, len(values), _ELEMENTS_PER_STOP_CHECK):
        check_stop()
        block = values[begin : begin + _ELEMENTS_PER_STOP_CHECK]
        with np.errstate(all="ignore"):  # invalid values may divide by 0 or overflow
            block[:] = decode(block).view(values.dtype)  # floats replace integers of the same size


def _decode_octahedral(values: NDArray[Any]) -> NDArray[Any]:
    """Return unit vectors, normalized integers, from octahedral coordinates, (N, 4) int8 or int16.

    The columns are x, y, the integer that stands for 1 in both, and a value that stays as it is.
    """
    x, y, one = values[:, :3].astype(np.float32).T
    z = one - (np.abs(x) + np.abs(y))
    fold = np.minimum(z, 0)
    xyz = np.stack((x + np.where(x >= 0, fold, -fold), y + np.where(y >= 0, fold, -fold), z), axis=1)
    lengths = np.sqrt(np.einsum("ij,ij->i", xyz, xyz))
    scale = np.iinfo(values.dtype).max / np.maximum(lengths, np.finfo(np.float32).tiny)
    result = values.copy()
    result[:, :3] = _rounded(xyz * scale[:, None])
    return result


def _decode_quaternions(values: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return unit quaternions, normalized integers, from their three smallest components, (N, 4) int16.

    The two lowest bits of the last column are the index of the fourth component. With both bits set, it is the integer
    that stands for 1 / sqrt(2).
    """
    omitted = values[:, 3] & 3
    scale = np.float32(np.sqrt(0.5)) / (values[:, 3] | 3).astype(np.float32)
    smallest = values[:, :3].astype(np.float32) * scale[:, None]
    largest = np.sqrt(np.maximum(1.0 - np.einsum("ij,ij->i", smallest, smallest), 0.0))
    result = np.empty_like(values)
    rows = np.arange(len(values))
    result[rows, omitted] = _rounded(largest * _MAX_INT16)
    for k in range(3):
        result[rows, (omitted + 1 + k) & 3] = _rounded(smallest[:, k] * _MAX_INT16)
    return result


def _decode_exponential(values: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return floats from integers: a signed exponent of base 2 in the upper 8 bits, a signed factor in the others."""
    factors, exponents = values << 8 >> 8, values >> 24  # shifts to the right keep the sign
    result: NDArray[np.float32] = np.ldexp(factors.astype(np.float32), exponents)
    return result


def _decode_colors(values: NDArray[Any]) -> NDArray[Any]:
    """Return RGBA, normalized integers, from YCoCg and alpha, (N, 4) uint8 or uint16.

    The columns are Y, signed Co and Cg, and alpha with one bit less. Above its bits, alpha has a bit of 1, which gives
    the number of bits of all four.
    """
    luma, alpha = values[:, 0].astype(np.int32), values[:, 3].astype(np.int32)
    orange, green = values[:, 1:3].view(f"i{values.itemsize}").astype(np.int32).T
    largest = np.maximum((1 << np.frexp(alpha)[1]) - 1, 1)
    alpha &= largest >> 1
    rgba = np.stack((luma + orange - green, luma + green, luma - orange - green, alpha << 1 | alpha & 1), axis=1)
    one = np.iinfo(values.dtype).max
    return np.clip(_rounded(rgba * (np.float32(one) / largest[:, None])), 0, one).astype(values.dtype)


def _rounded(values: NDArray[np.float32]) -> NDArray[np.int32]:
    """Round to the nearest integer, halves away from zero."""
    return np.trunc(values + np.copysign(np.float32(0.5), values)).astype(np.int32)
