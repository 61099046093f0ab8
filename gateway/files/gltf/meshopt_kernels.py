"""Decoders of the three bitstreams of KHR_meshopt_compression; ``meshopt`` calls them.

The formats are those of the extension's appendix A. EXT_meshopt_compression has version 0 of the attributes. Decoders
check every read against the stream's end; decoded vertex indices may be any number, and are checked where meshes are
read.
"""

from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.kernel_types import I64, U8, Address, Pointer, i64
from renderers.compiler.pointers import address_of, advance, stack_array, u8_at, u32_at
from renderers.stop import current_stop

ATTRIBUTES_HEADERS: Final = (0xA0, 0xA1)
"""First byte of versions 0 and 1."""
TRIANGLES_HEADERS: Final = (0xE1,)
INDICES_HEADERS: Final = (0xD1,)
_GROUP: Final = 16
"""Elements of a group. Bytes of a group are stored with equal numbers of bits."""
_MAX_BLOCK_BYTES: Final = 8192
_MAX_BLOCK_ELEMENTS: Final = 256
_CHANNEL: Final = 4
"""Bytes of an element that have one channel mode."""
_MIN_TAIL_BYTES: Final = (32, 24)
"""Bytes that a stream of attributes ends with, at least, by its version."""
_FEW_BITS, _MORE_BITS, _ZEROS, _LITERAL, _VERSION_0 = range(5)
"""How a byte of the elements in a block is stored: the control modes of version 1, and the way of version 0."""
_BYTES, _WORDS, _XOR = range(3)
"""Channel modes: differences of bytes, of 16-bit integers, or of the bits of 32-bit integers."""
_CODE_TABLE_BYTES: Final = 16
"""Bytes of the table at the end of a stream of triangles."""
_INDICES_TAIL_BYTES: Final = 4
_FIFO: Final = 16
"""Edges, and vertices, that a triangle can refer to."""
_NO_POSITION: Final = -1
"""Position after a part of a stream that is truncated."""
_NOT_RECENT: Final = -1
"""Vertex in place of one in the FIFO, for digits that never count back."""
_OK, _TRUNCATED, _TRAILING_BYTES, _UNKNOWN_MODE = range(4)
_ERRORS: Final = {
    _TRUNCATED: "the stream is truncated",
    _TRAILING_BYTES: "the stream has bytes after its end",
    _UNKNOWN_MODE: "the stream has an unknown channel mode",
}
_STEPS_PER_STOP_CHECK: Final = 1 << 16
"""Triangles or indices that a kernel decodes between two checks of the ``StopFlag``."""

_fifos: Final = stack_array(I64, 3 * _FIFO)
T = TypeVar("T", bound=np.generic)


class MeshoptError(ValueError):
    """The stream cannot be decoded."""


def decode_attributes(stream: NDArray[np.uint8], count: int, size: int) -> NDArray[np.uint8]:
    """Decode a stream of mode ``ATTRIBUTES``, (N,) uint8, to ``count`` elements of ``size`` bytes, (count, size) uint8.

    The size is a multiple of 4, at most 256. Raises MeshoptError if the stream has another header or an unknown mode,
    is truncated, or has bytes after its end.
    """
    return _decoded(_decode_attributes, ATTRIBUTES_HEADERS, stream, np.empty((count, size), np.uint8), count, size)


def decode_triangles(stream: NDArray[np.uint8], count: int) -> NDArray[np.uint32]:
    """Decode a stream of mode ``TRIANGLES``: ``count`` vertex indices, a multiple of 3; as ``decode_attributes``."""
    return _decoded(_decode_triangles, TRIANGLES_HEADERS, stream, np.empty(count, np.uint32), count // 3)


def decode_indices(stream: NDArray[np.uint8], count: int) -> NDArray[np.uint32]:
    """Decode a stream of mode ``INDICES``: ``count`` vertex indices; as ``decode_attributes``."""
    return _decoded(_decode_indices, INDICES_HEADERS, stream, np.empty(count, np.uint32), count)


def _decoded(
    kernel: Any, headers: tuple[int, ...], stream: NDArray[np.uint8], result: NDArray[T], *sizes: int
) -> NDArray[T]:
    """Return ``result`` after a kernel has decoded a stream into it. ``sizes`` are the kernel's other arguments."""
    if len(stream) == 0 or stream[0] not in headers:
        found = f"0x{stream[0]:02x}" if len(stream) else "nothing"
        expected = " or ".join(f"0x{header:02x}" for header in headers)
        raise MeshoptError(f"the stream starts with {found} instead of {expected}")
    stop = current_stop()
    addresses = address_of(stream, np.uint8), len(stream), address_of(result, result.dtype)
    status = kernel(*addresses, *sizes, stop.address)
    stop.check()
    if status != _OK:
        raise MeshoptError(_ERRORS[status])
    return result


@kernel
def _decode_attributes(
    stream_at: Address, stream_size: I64, elements_at: Address, count: I64, size: I64, stop_at: Address
) -> I64:
    """Write the result of ``decode_attributes``; return ``_OK`` or an error.

    A block of elements has, for each byte of an element: 2 bits per group of 16 elements (the number of bits of each
    value), and then the groups. In version 1, the block begins with 2 bits for each byte of an element, which say how
    that byte is stored. The values are differences from the previous element. The element before the first one is at
    the end of the stream; in version 1, a byte for each channel follows it, which says what the differences are.
    """
    stream, elements = u8_at(stream_at), u8_at(elements_at)
    version = i64(stream[0]) & 1
    channel_count = size // _CHANNEL
    modes_at = stream_size - version * channel_count
    end = min(modes_at - size, stream_size - _MIN_TAIL_BYTES[version])
    if end < 1:
        return _TRUNCATED
    block_size = min(_MAX_BLOCK_BYTES // size // _GROUP * _GROUP, _MAX_BLOCK_ELEMENTS)
    position = 1
    for begin in range(0, count, block_size):
        if is_set(stop_at):
            return _OK
        block_end = min(begin + block_size, count)
        controls_at = position
        position += version * channel_count
        if position > end:
            return _TRUNCATED
        for byte_index in range(size):
            control = i64(_VERSION_0)
            if version == 1:
                control = (i64(stream[controls_at + byte_index // 4]) >> (byte_index % 4 * 2)) & 3
            position = _decode_block_byte(stream, position, end, control, elements, begin, block_end, size, byte_index)
            if position == _NO_POSITION:
                return _TRUNCATED
        previous = advance(stream, modes_at - size)
        if begin > 0:
            previous = advance(elements, (begin - 1) * size)
        for channel in range(channel_count):
            mode = i64(stream[modes_at + channel]) if version == 1 else _BYTES
            at = channel * _CHANNEL
            if mode == _BYTES:
                for k in range(_CHANNEL):
                    _add_differences(elements, previous, begin, block_end, size, at + k, 1, 0)
            elif mode == _WORDS:
                _add_differences(elements, previous, begin, block_end, size, at, 2, 0)
                _add_differences(elements, previous, begin, block_end, size, at + 2, 2, 0)
            elif mode & 15 == _XOR:
                _add_differences(elements, previous, begin, block_end, size, at, 4, mode >> 4)
            else:
                return _UNKNOWN_MODE
    return _OK if position == end else _TRAILING_BYTES


@inlined
def _decode_block_byte(
    stream: Pointer[U8],
    position: I64,
    end: I64,
    control: I64,
    elements: Pointer[U8],
    begin: I64,
    block_end: I64,
    size: I64,
    byte_index: I64,
) -> I64:
    """Decode one byte of the difference of each element of a block; return the position after it, or _NO_POSITION.

    ``control`` says how the byte is stored, such as ``_ZEROS``; the block has the elements from ``begin`` to
    ``block_end``.
    """
    if control == _ZEROS:
        for element in range(begin, block_end):
            elements[element * size + byte_index] = 0
        return position
    if control == _LITERAL:
        if position + block_end - begin > end:
            return _NO_POSITION
        for element in range(begin, block_end):
            elements[element * size + byte_index] = stream[position + element - begin]
        return position + block_end - begin
    header = position
    group_count = (block_end - begin + _GROUP - 1) // _GROUP
    position += (group_count + 3) // 4
    if position > end:
        return _NO_POSITION
    for group in range(group_count):
        bits = _bits_of_group(stream, header, group, control)
        packed = position
        position += _GROUP * bits // 8
        if position > end:
            return _NO_POSITION
        escape = (1 << bits) - 1
        first = begin + group * _GROUP
        for in_group in range(_GROUP):
            value = i64(0)
            if bits > 0:
                value = _packed_value(stream, packed, in_group, bits, escape)
                if value == escape and bits < 8:  # the value follows the group
                    if position >= end:
                        return _NO_POSITION
                    value = i64(stream[position])
                    position += 1
            if first + in_group < block_end:
                elements[(first + in_group) * size + byte_index] = value
    return position


@inlined
def _bits_of_group(stream: Pointer[U8], header: I64, group: I64, control: I64) -> I64:
    """Return the number of bits of each value in a group: 0, 1, 2, 4 or 8."""
    power = 1 << ((i64(stream[header + group // 4]) >> (group % 4 * 2)) & 3)
    if control == _VERSION_0:
        return power & ~1  # 0, 2, 4 or 8
    return power >> 1 if control == _FEW_BITS else power


@inlined
def _add_differences(
    elements: Pointer[U8],
    previous: Pointer[U8],
    begin: I64,
    block_end: I64,
    size: I64,
    at: I64,
    width: I64,
    rotation: I64,
) -> None:
    """Replace the differences of an integer in the elements of a block by its values; ``previous`` is the one before.

    ``at`` and ``width`` are its first byte in an element, and its number of bytes. If there are 4, the difference is
    the exclusive or, rotated to the left by ``rotation`` bits; else it is zigzag-coded.
    """
    mask = (1 << 8 * width) - 1
    value = _integer_at(previous, at, width)
    for element in range(begin, block_end):
        first = element * size + at
        difference = _integer_at(elements, first, width)
        if width == 4:
            value ^= (difference >> rotation | difference << (32 - rotation)) & mask
        else:
            value = (value + ((difference >> 1) ^ -(difference & 1))) & mask
        for k in range(width):
            elements[first + k] = (value >> 8 * k) & 0xFF


@inlined
def _integer_at(elements: Pointer[U8], at: I64, width: I64) -> I64:
    """Return the little-endian integer of ``width`` bytes at an index."""
    value = i64(0)
    for k in range(width):
        value |= i64(elements[at + k]) << 8 * k
    return value


@inlined
def _packed_value(stream: Pointer[U8], packed: I64, in_group: I64, bits: I64, mask: I64) -> I64:
    """Return the value at an index in a group that starts at ``packed``. ``mask`` has ``bits`` ones."""
    bit = in_group * bits
    shift = bit % 8 if bits == 1 else 8 - bits - bit % 8
    return (i64(stream[packed + bit // 8]) >> shift) & mask


@device_function
def _read_varint(stream: Pointer[U8], position: I64, end: I64) -> tuple[I64, I64]:
    """Return an unsigned LEB128 number of at most 5 bytes and the position after it; a truncated one ends early."""
    value = i64(0)
    for shift in range(0, 35, 7):
        if position >= end:
            break
        byte = i64(stream[position])
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            break
    return value, position


@inlined
def _triangle_digits(stream: Pointer[U8], code: I64, position: I64, end: I64) -> tuple[I64, I64, I64, I64]:
    """Return the digits of the three vertices, for a code without a shared edge, and the position after them."""
    if code < 0xFE:  # one of the pairs in the table at the end
        digits = i64(stream[end + (code & 15)])
        return 0, digits >> 4, digits & 15, position
    digits = i64(stream[position])
    return (0 if code == 0xFE else 15), digits >> 4, digits & 15, position + 1


@inlined
def _vertex_of(
    digit: I64, stream: Pointer[U8], position: I64, end: I64, recent: I64, next_vertex: I64, last_explicit: I64
) -> tuple[I64, I64, I64, I64]:
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
def _push(fifo: Pointer[I64], end: I64, value: I64) -> I64:
    """Replace the oldest value of a FIFO, and return the index of the next one."""
    fifo[end] = value
    return (end + 1) & (_FIFO - 1)


@inlined
def _push_edge(edges_a: Pointer[I64], edges_b: Pointer[I64], end: I64, a: I64, b: I64) -> I64:
    """Replace the oldest edge by the one from a to b, and return the index of the next one."""
    edges_a[end], edges_b[end] = a, b
    return (end + 1) & (_FIFO - 1)


@kernel
def _decode_triangles(
    stream_at: Address, stream_size: I64, indices_at: Address, triangle_count: I64, stop_at: Address
) -> I64:
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
    next_vertex = last_explicit = i64(0)
    for triangle in range(triangle_count):
        if position > end:
            return _TRUNCATED
        if triangle % _STEPS_PER_STOP_CHECK == 0 and is_set(stop_at):
            return _OK
        code = i64(stream[1 + triangle])
        shares_edge = code < 0xF0
        if shares_edge:
            edge = (edge_end - 1 - (code >> 4)) & (_FIFO - 1)
            a, b, c_digit = edges_a[edge], edges_b[edge], code & 15
            recent = vertices[(vertex_end - 1 - c_digit) & (_FIFO - 1)]
        else:
            a_digit, b_digit, c_digit, position = _triangle_digits(stream, code, position, end)
            if code >= 0xFE and b_digit == 0 and c_digit == 0:
                next_vertex = i64(0)
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


@kernel
def _decode_indices(stream_at: Address, stream_size: I64, indices_at: Address, count: I64, stop_at: Address) -> I64:
    """Write the result of ``decode_indices``; return ``_OK`` or an error.

    An index is a zigzag-coded difference from the last index of one of two sequences; the lowest bit says of which.
    """
    stream, indices = u8_at(stream_at), u32_at(indices_at)
    end = stream_size - _INDICES_TAIL_BYTES
    if end < 1:
        return _TRUNCATED
    position = 1
    last0 = last1 = i64(0)
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
