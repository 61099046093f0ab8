"""Decoders of the three bitstreams of EXT_meshopt_compression; ``meshopt`` calls them.

The formats are those of the extension's appendix A. Decoders check every read against the stream's end; decoded vertex
indices may be any number, and are checked where meshes are read.
"""

from __future__ import annotations

from typing import Any, Final, TypeVar

import numpy as np
from numba import types
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import address_of, advance, stack_array, u8_at, u32_at
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
_NO_POSITION: Final = -1
"""Position after a part of a stream that is truncated."""
_NOT_RECENT: Final = -1
"""Vertex in place of one in the FIFO, for digits that never count back."""
_OK: Final = 0
_TRUNCATED: Final = 1
_TRAILING_BYTES: Final = 2
_ERRORS: Final = {_TRUNCATED: "the stream is truncated", _TRAILING_BYTES: "the stream has bytes after its end"}
_STEPS_PER_STOP_CHECK: Final = 1 << 16
"""Triangles or indices that a kernel decodes between two checks of the ``StopFlag``."""


_fifos: Final = stack_array(types.int64, 3 * _FIFO)
T = TypeVar("T", bound=np.generic)


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
    return _decoded(_decode_attributes, ATTRIBUTES_HEADER, stream, np.empty((count, size), np.uint8), count, size)


def decode_triangles(stream: NDArray[np.uint8], count: int) -> NDArray[np.uint32]:
    """Decode a stream of mode ``TRIANGLES``: ``count`` vertex indices, a multiple of 3; as ``decode_attributes``."""
    return _decoded(_decode_triangles, TRIANGLES_HEADER, stream, np.empty(count, np.uint32), count // 3)


def decode_indices(stream: NDArray[np.uint8], count: int) -> NDArray[np.uint32]:
    """Decode a stream of mode ``INDICES``: ``count`` vertex indices; as ``decode_attributes``."""
    return _decoded(_decode_indices, INDICES_HEADER, stream, np.empty(count, np.uint32), count)


def _decoded(kernel: Any, header: int, stream: NDArray[np.uint8], result: NDArray[T], *sizes: int) -> NDArray[T]:
    """Return ``result`` after a kernel has decoded a stream into it. ``sizes`` are the kernel's other arguments."""
    if len(stream) == 0 or stream[0] != header:
        found = f"0x{stream[0]:02x}" if len(stream) else "nothing"
        raise MeshoptError(f"the stream starts with {found} instead of 0x{header:02x}")
    stop = current_stop()
    addresses = address_of(stream, np.uint8), len(stream), address_of(result, result.dtype)
    status = kernel(*addresses, *sizes, stop.address)
    stop.check()
    if status != _OK:
        raise MeshoptError(_ERRORS[status])
    return result


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
        block_end = min(begin + block_size, count)
        for byte_index in range(size):
            last_at = stream_size - size + byte_index
            previous = np.int64(stream[last_at]) if begin == 0 else elements[(begin - 1) * size + byte_index]
            position = _decode_block_byte(stream, position, end, previous, elements, begin, block_end, size, byte_index)
            if position == _NO_POSITION:
                return _TRUNCATED
    return _OK if position == end else _TRAILING_BYTES


@inlined
def _decode_block_byte(stream, position, end, previous, elements, begin, block_end, size, byte_index):
    """Decode one byte of each element of a block; return the position after it, or _NO_POSITION if truncated.

    Args:
        previous: this byte of the element before the block.
        begin, block_end: the block's elements.
    """
    header = position
    group_count = (block_end - begin + _GROUP - 1) // _GROUP
    position += (group_count + 3) // 4
    if position > end:
        return _NO_POSITION
    for group in range(group_count):
        bits = _bits_of_group(stream, header, group)
        packed = position
        position += _GROUP * bits // 8
        if position > end:
            return _NO_POSITION
        escape = (1 << bits) - 1
        first = begin + group * _GROUP
        for in_group in range(_GROUP):
            value = np.int64(0)
            if bits > 0:
                value = _packed_value(stream, packed, in_group, bits, escape)
                if value == escape and bits < 8:  # the value follows the group
                    if position >= end:
                        return _NO_POSITION
                    value = np.int64(stream[position])
                    position += 1
            if first + in_group < block_end:
                previous = (previous + ((value >> 1) ^ -(value & 1))) & 0xFF
                elements[(first + in_group) * size + byte_index] = previous
    return position


@inlined
def _bits_of_group(stream, header, group):
    """Return the number of bits of each value in a group: 0, 2, 4 or 8."""
    width = (np.int64(stream[header + group // 4]) >> (group % 4 * 2)) & 3
    return 8 if width == 3 else 2 * width


@inlined
def _packed_value(stream, packed, in_group, bits, mask):
    """Return the value at an index in a group that starts at ``packed``. ``mask`` has ``bits`` ones."""
    bit = in_group * bits
    return (np.int64(stream[packed + bit // 8]) >> (8 - bits - bit % 8)) & mask


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


@inlined
def _triangle_digits(stream, code, position, end):
    """Return the digits of the three vertices, for a code without a shared edge, and the position after them."""
    if code < 0xFE:  # one of the pairs in the table at the end
        digits = np.int64(stream[end + (code & 15)])
        return 0, digits >> 4, digits & 15, position
    digits = np.int64(stream[position])
    return (0 if code == 0xFE else 15), digits >> 4, digits & 15, position + 1


@inlined
def _vertex_of(digit, stream, position, end, recent, next_vertex, last_explicit):
    """Return the vertex of a digit, and the new values of ``position``, ``next_vertex`` and ``last_explicit``.

    A digit of 0 is the next vertex that was not used before. 15 is a vertex that is stored as the zigzag-coded
    difference from the last explicit one. Others count back in the FIFO: they are the vertex ``recent``.
    """
    if digit == 0:
        return next_vertex, position, next_vertex + 1, last_explicit
    if digit == 15:
        difference, position = _read_varint(stream, position, end)
        last_explicit += (difference >> 1) ^ -(difference & 1)
        return last_explicit, position, next_vertex, last_explicit
    return recent, position, next_vertex, last_explicit


@inlined
def _push(fifo, end, value):
    """Replace the oldest value of a FIFO, and return the index of the next one."""
    fifo[end] = value
    return (end + 1) & (_FIFO - 1)


@inlined
def _push_edge(edges_a, edges_b, end, a, b):
    """Replace the oldest edge by the one from a to b, and return the index of the next one."""
    edges_a[end], edges_b[end] = a, b
    return (end + 1) & (_FIFO - 1)


@kernel("int64(int64, int64, int64, int64, int64)")
def _decode_triangles(stream_at, stream_size, indices_at, triangle_count, stop_at):
    """Write the result of ``decode_triangles``; return ``_OK`` or an error.

    Each triangle has a code byte. If its high digit is below 15, it shares one of the last 16 edges, and the low digit
    is the third vertex; of these, 13 and 14 are the vertices before and after the last explicit one. Otherwise each of
    the three vertices has a digit.
    """
    stream, indices = u8_at(stream_at), u32_at(indices_at)
    edges_a = _fifos()
    edges_b, vertices = advance(edges_a, _FIFO), advance(edges_a, 2 * _FIFO)
    for k in range(3 * _FIFO):
        edges_a[k] = -1
    end = stream_size - _CODE_TABLE_BYTES
    position = 1 + triangle_count
    edge_end = vertex_end = 0
    next_vertex = last_explicit = np.int64(0)
    for triangle in range(triangle_count):
        if position > end:
            return _TRUNCATED
        if triangle % _STEPS_PER_STOP_CHECK == 0 and is_set(stop_at):
            return _OK
        code = np.int64(stream[1 + triangle])
        shares_edge = code < 0xF0
        if shares_edge:
            edge = (edge_end - 1 - (code >> 4)) & (_FIFO - 1)
            a, b, c_digit = edges_a[edge], edges_b[edge], code & 15
            recent = vertices[(vertex_end - 1 - c_digit) & (_FIFO - 1)]
        else:
            a_digit, b_digit, c_digit, position = _triangle_digits(stream, code, position, end)
            if code >= 0xFE and b_digit == 0 and c_digit == 0:
                next_vertex = np.int64(0)
            recent_b = vertices[(vertex_end - b_digit) & (_FIFO - 1)]
            recent = vertices[(vertex_end - c_digit) & (_FIFO - 1)]
            # a_digit is 0 or 15.
            a, position, next_vertex, last_explicit = _vertex_of(
                a_digit, stream, position, end, _NOT_RECENT, next_vertex, last_explicit
            )
            b, position, next_vertex, last_explicit = _vertex_of(
                b_digit, stream, position, end, recent_b, next_vertex, last_explicit
            )
            vertex_end = _push(vertices, vertex_end, a)
            if b_digit == 0 or b_digit == 15:
                vertex_end = _push(vertices, vertex_end, b)
            edge_end = _push_edge(edges_a, edges_b, edge_end, b, a)
        beside_explicit = shares_edge and 13 <= c_digit < 15
        if beside_explicit:
            last_explicit += -1 if c_digit == 13 else 1
            c = last_explicit
        else:
            c, position, next_vertex, last_explicit = _vertex_of(
                c_digit, stream, position, end, recent, next_vertex, last_explicit
            )
        indices[3 * triangle], indices[3 * triangle + 1], indices[3 * triangle + 2] = a, b, c
        if c_digit == 0 or c_digit == 15 or beside_explicit:
            vertex_end = _push(vertices, vertex_end, c)
        edge_end = _push_edge(edges_a, edges_b, edge_end, c, b)
        edge_end = _push_edge(edges_a, edges_b, edge_end, a, c)
    if position > end:
        return _TRUNCATED
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
