"""Decoders of the three bitstreams of EXT_meshopt_compression; ``meshopt`` calls them.

The formats are those of the extension's appendix A. Decoders check every read against the stream's end; decoded vertex
indices may be any number, and are checked where meshes are read.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import address_of, i64_at, u8_at, u32_at
from renderers.stop import current_stop

ATTRIBUTES_HEADER: Final = 0xA0
TRIANGLES_HEADER: Final = 0xE1
INDICES_HEADER: Final = 0xD1
_GROUP: Final = 16
"""Elements of a group. Bytes of a group are stored with equal numbers of bits."""
_MAX_BLOCK_BYTES: Final = 8192
_MAX_BLOCK_ELEMENTS: Final = 256
_MIN_TAIL_BYTES: Final = 32
_CODE_TABLE_BYTES: Final = 16
"""Bytes of the table at the end of a stream of triangles."""
_INDICES_TAIL_BYTES: Final = 4
_FIFO: Final = 16
"""Edges, and vertices, that a triangle can refer to."""
_OK: Final = 0
_TRUNCATED: Final = 1
_TRAILING_BYTES: Final = 2
_ERRORS: Final = {_TRUNCATED: "the stream is truncated", _TRAILING_BYTES: "the stream has bytes after its end"}
_STEPS_PER_STOP_CHECK: Final = 1 << 16
"""Triangles or indices that a kernel decodes between two checks of the ``StopFlag``."""


class MeshoptError(ValueError):
    """The stream cannot be decoded."""


def decode_attributes(stream: NDArray[np.uint8], count: int, size: int) -> NDArray[np.uint8]:
    """Decode a stream of mode ``ATTRIBUTES``.

    Args:
        stream: (N,) uint8.
        count: Number of elements.
        size: Bytes of an element: a multiple of 4, at most 256.

    Returns:
        (count, size) uint8.

    Raises:
        MeshoptError: The stream has another header, is truncated, or has bytes after its end.
    """
    _check_header(stream, ATTRIBUTES_HEADER)
    elements = np.empty((count, size), np.uint8)
    stop = current_stop()
    status = _decode_attributes(
        *(address_of(stream, np.uint8), len(stream), address_of(elements, np.uint8), count, size, stop.address)
    )
    stop.check()
    _check_status(status)
    return elements


def decode_triangles(stream: NDArray[np.uint8], count: int) -> NDArray[np.uint32]:
    """Decode a stream of mode ``TRIANGLES``.

    Args:
        stream: (N,) uint8.
        count: Number of vertex indices, a multiple of 3.

    Returns:
        (count,) uint32.

    Raises:
        MeshoptError: As for ``decode_attributes``.
    """
    _check_header(stream, TRIANGLES_HEADER)
    indices = np.empty(count, np.uint32)
    fifo = np.full((3, _FIFO), -1, np.int64)
    stop = current_stop()
    status = _decode_triangles(
        *(address_of(stream, np.uint8), len(stream), address_of(indices, np.uint32), count // 3),
        *(address_of(fifo, np.int64), stop.address),
    )
    stop.check()
    _check_status(status)
    return indices


def decode_indices(stream: NDArray[np.uint8], count: int) -> NDArray[np.uint32]:
    """Decode a stream of mode ``INDICES``: ``count`` vertex indices, as ``decode_triangles``."""
    _check_header(stream, INDICES_HEADER)
    indices = np.empty(count, np.uint32)
    stop = current_stop()
    status = _decode_indices(
        *(address_of(stream, np.uint8), len(stream), address_of(indices, np.uint32), count, stop.address)
    )
    stop.check()
    _check_status(status)
    return indices


def _check_header(stream: NDArray[np.uint8], expected: int) -> None:
    if len(stream) == 0 or stream[0] != expected:
        found = f"0x{stream[0]:02x}" if len(stream) else "nothing"
        raise MeshoptError(f"the stream starts with {found} instead of 0x{expected:02x}")


def _check_status(status: int) -> None:
    if status != _OK:
        raise MeshoptError(_ERRORS[status])


@kernel("int64(int64, int64, int64, int64, int64, int64)")
def _decode_attributes(stream_at, stream_size, elements_at, count, size, stop_at):
    """Write the result of ``decode_attributes``; return ``_OK`` or an error.

    A block of elements has, for each byte of an element: 2 bits per group of 16 elements (0, 2, 4 or 8 bits per byte),
    and then the groups. Bytes are stored as zigzag-coded differences from the byte of the previous element. The
    element before the first one is at the end of the stream.
    """
    stream, elements = u8_at(stream_at), u8_at(elements_at)
    tail = max(size, _MIN_TAIL_BYTES)
    end = stream_size - tail
    if end < 1:
        return _TRUNCATED
    block_size = min(_MAX_BLOCK_BYTES // size // _GROUP * _GROUP, _MAX_BLOCK_ELEMENTS)
    position = 1
    for begin in range(0, count, block_size):
        if is_set(stop_at):
            return _OK
        block_count = min(block_size, count - begin)
        group_count = (block_count + _GROUP - 1) // _GROUP
        header_bytes = (group_count + 3) // 4
        for k in range(size):
            header = position
            position += header_bytes
            if position > end:
                return _TRUNCATED
            previous = np.int64(stream[stream_size - size + k]) if begin == 0 else elements[(begin - 1) * size + k]
            for group in range(group_count):
                width = (np.int64(stream[header + group // 4]) >> (group % 4 * 2)) & 3
                bits = 8 if width == 3 else 2 * width
                packed = position
                position += _GROUP * bits // 8
                if position > end:
                    return _TRUNCATED
                escape = (1 << bits) - 1
                first = begin + group * _GROUP
                for j in range(_GROUP):
                    value = np.int64(0)
                    if bits > 0:
                        bit = j * bits
                        value = (np.int64(stream[packed + bit // 8]) >> (8 - bits - bit % 8)) & escape
                        if value == escape and bits < 8:  # the value follows the group
                            if position >= end:
                                return _TRUNCATED
                            value = np.int64(stream[position])
                            position += 1
                    if first + j < begin + block_count:
                        previous = (previous + ((value >> 1) ^ -(value & 1))) & 0xFF
                        elements[(first + j) * size + k] = previous
    return _OK if position == end else _TRAILING_BYTES


@device_function
def _read_varint(stream, position, end):
    """Return an unsigned LEB128 number of at most 5 bytes and the position after it; a truncated one ends early."""
    value = np.int64(0)
    for shift in range(0, 35, 7):
        if position >= end:
            break
        byte = np.int64(stream[position])
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            break
    return value, position


@kernel("int64(int64, int64, int64, int64, int64, int64)")
def _decode_triangles(stream_at, stream_size, indices_at, triangle_count, fifo_at, stop_at):
    """Write the result of ``decode_triangles``; return ``_OK`` or an error.

    Each triangle has a code byte of two hexadecimal digits. A high digit below 15 is one of the last 16 edges, and the
    low digit is the third vertex. Otherwise, each of the three vertices has a digit. A digit of 0 is the next vertex
    that was not used before, 15 a vertex that is stored explicitly; others are one of the last 16 vertices.

    Args:
        fifo_at: address of scratch memory: (3, 16) int64, all -1. The last edges' first and second vertices, and the
            last vertices.
    """
    stream, indices = u8_at(stream_at), u32_at(indices_at)
    edge_a, edge_b, vertices = i64_at(fifo_at), i64_at(fifo_at + 8 * _FIFO), i64_at(fifo_at + 16 * _FIFO)
    end = stream_size - _CODE_TABLE_BYTES
    position = 1 + triangle_count
    if position > end:
        return _TRUNCATED
    edge_end = vertex_end = next_vertex = last_vertex = 0
    for triangle in range(triangle_count):
        if triangle % _STEPS_PER_STOP_CHECK == 0 and is_set(stop_at):
            return _OK
        code = np.int64(stream[1 + triangle])
        shared_edge = code < 0xF0
        if shared_edge:
            k = (edge_end - 1 - (code >> 4)) & (_FIFO - 1)
            a, b = edge_a[k], edge_b[k]
            digit_a, digits = 1, 0x10 | (code & 15)
        else:
            a = b = np.int64(0)
            digit_a = 0
            if code < 0xFE:
                digits = np.int64(stream[end + (code & 15)])
            else:
                if position >= end:
                    return _TRUNCATED
                digits = np.int64(stream[position])
                position += 1
                digit_a = 0 if code == 0xFE else 15
                if digits == 0:
                    next_vertex = 0
        digit_b, digit_c = digits >> 4, digits & 15
        # The vertices in the FIFO are those before this triangle. Digit 0 is the next new vertex.
        if not shared_edge:
            if digit_a == 0:
                a = next_vertex
                next_vertex += 1
            if digit_b == 0:
                b = next_vertex
                next_vertex += 1
            elif digit_b < 15:
                b = vertices[(vertex_end - digit_b) & (_FIFO - 1)]
        c = 0
        if digit_c == 0:
            c = next_vertex
            next_vertex += 1
        elif shared_edge and digit_c >= 13:  # 13, 14: before and after the last explicit vertex
            if digit_c < 15:
                last_vertex += 1 if digit_c == 14 else -1
                c = last_vertex
        elif digit_c < 15:
            k = vertex_end - 1 - digit_c if shared_edge else vertex_end - digit_c
            c = vertices[k & (_FIFO - 1)]
        # An explicit vertex is stored as the zigzag-coded difference from the last explicit one.
        if digit_a == 15:
            difference, position = _read_varint(stream, position, end)
            last_vertex += (difference >> 1) ^ -(difference & 1)
            a = last_vertex
        if not shared_edge and digit_b == 15:
            difference, position = _read_varint(stream, position, end)
            last_vertex += (difference >> 1) ^ -(difference & 1)
            b = last_vertex
        if digit_c == 15:
            difference, position = _read_varint(stream, position, end)
            last_vertex += (difference >> 1) ^ -(difference & 1)
            c = last_vertex
        indices[3 * triangle], indices[3 * triangle + 1], indices[3 * triangle + 2] = a, b, c
        if not shared_edge:
            vertices[vertex_end] = a
            vertex_end = (vertex_end + 1) & (_FIFO - 1)
            if digit_b == 0 or digit_b == 15:
                vertices[vertex_end] = b
                vertex_end = (vertex_end + 1) & (_FIFO - 1)
            edge_a[edge_end], edge_b[edge_end] = b, a
            edge_end = (edge_end + 1) & (_FIFO - 1)
        if digit_c == 0 or digit_c == 15 or (shared_edge and digit_c >= 13):
            vertices[vertex_end] = c
            vertex_end = (vertex_end + 1) & (_FIFO - 1)
        edge_a[edge_end], edge_b[edge_end] = c, b
        edge_end = (edge_end + 1) & (_FIFO - 1)
        edge_a[edge_end], edge_b[edge_end] = a, c
        edge_end = (edge_end + 1) & (_FIFO - 1)
    return _OK if position == end else _TRAILING_BYTES


@kernel("int64(int64, int64, int64, int64, int64)")
def _decode_indices(stream_at, stream_size, indices_at, count, stop_at):
    """Write the result of ``decode_indices``; return ``_OK`` or an error.

    An index is a zigzag-coded difference from the last index of one of two sequences; the lowest bit says of which.
    """
    stream, indices = u8_at(stream_at), u32_at(indices_at)
    end = stream_size - _INDICES_TAIL_BYTES
    if end < 1:
        return _TRUNCATED
    position = 1
    last0 = last1 = np.int64(0)
    for k in range(count):
        if k % _STEPS_PER_STOP_CHECK == 0 and is_set(stop_at):
            return _OK
        if position >= end:
            return _TRUNCATED
        value, position = _read_varint(stream, position, end)
        difference = value >> 1
        index = (difference >> 1) ^ -(difference & 1)
        if value & 1:
            index += last1
            last1 = index
        else:
            index += last0
            last0 = index
        indices[k] = index
    return _OK if position == end else _TRAILING_BYTES
