"""Compiled loops over JSON text that run without the interpreter's lock: find long number arrays, read them.

A mesh or point cloud of 100,000 vertices is 11 MB of digits. Python's JSON readers turn them into a million objects in
0.1 to 0.5 s during which nothing else in the process runs; here they become arrays in 30 ms while others work.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit

_BYTES = types.Array(types.uint8, 1, "C", readonly=True)
_POWERS = types.Array(types.float64, 1, "C", readonly=True)
_SINGLES = types.Array(types.float32, 1, "C", readonly=True)
_TABLE = types.Array(types.int64, 2, "C")
_SPAN = types.Tuple((types.int64,) * 5)

_FOUND = types.UniTuple(types.int64, 2)

QUOTE, BACKSLASH, OPEN, CLOSE, COMMA = ord('"'), ord("\\"), ord("["), ord("]"), ord(",")
BRACE, END_BRACE, COLON = ord("{"), ord("}"), ord(":")
MINUS, PLUS, DOT, ZERO, NINE = ord("-"), ord("+"), ord("."), ord("0"), ord("9")
LOWER_E, UPPER_E, UPPER_N, UPPER_I = ord("e"), ord("E"), ord("N"), ord("I")
SPACE, TAB, NEWLINE, RETURN = 32, 9, 10, 13
_NAN: Final = np.frombuffer(b"NaN", np.uint8)
_INFINITY: Final = np.frombuffer(b"Infinity", np.uint8)

RAGGED: Final = -1
"""Instead of the numbers in each row: the rows differ in length."""


def powers_of_ten() -> NDArray[np.float64]:
    """10^0 .. 10^308, each rounded correctly."""
    powers = np.array([float(f"1e{i}") for i in range(309)])
    powers.flags.writeable = False
    return powers


def _kinds() -> NDArray[np.uint8]:
    kinds = np.zeros(256, np.uint8)
    kinds[list(b"0123456789+-.eE")] = NUMBER
    kinds[list(b"NaInfity")] = NUMBER
    kinds[list(b", \n\r\t")] = SEPARATOR
    kinds[OPEN], kinds[CLOSE] = OPENS, CLOSES
    return kinds


NUMBER, SEPARATOR, OPENS, CLOSES = 1, 2, 3, 4
_KIND: Final = _kinds()
"""What a character can be in an array of numbers: those of NaN and Infinity (Python's json writes them) count as
numbers', those that only true, false, null and strings have do not."""


@cached_njit(_SPAN(_BYTES, types.int64), nogil=True)
def _span(data, begin):
    """The array that opens at ``begin``: (end, numbers, rows, columns, depth); end is -1 if it has more than numbers.

    Looks at characters only; ``read_numbers`` checks the grammar, and relies on the closing bracket that is here
    the last byte of every span.
    """
    depth = 0
    deepest = 0
    count = 0
    rows = 0
    columns = -2
    row = 0
    inside = False
    i = begin
    n = data.shape[0]
    while i < n:
        kind = _KIND[data[i]]
        if kind == NUMBER:
            if not inside:
                if depth != deepest:
                    break
                inside = True
                count += 1
                row += 1
        elif kind == SEPARATOR:
            inside = False
        elif kind == OPENS:
            depth += 1
            if inside or depth > 2 or (depth > deepest and count > 0):
                break
            deepest = max(deepest, depth)
            row = 0
        elif kind == CLOSES:
            inside = False
            depth -= 1
            if depth == 0:
                return i + 1, count, rows, columns, deepest
            rows += 1
            if columns == -2:
                columns = row
            elif columns != row:
                columns = RAGGED
        else:
            break
        i += 1
    return -1, 0, 0, 0, 0


@cached_njit(types.int64(_BYTES, _TABLE, types.int64), nogil=True)
def find_arrays(data, table, least):
    """Fills ``table`` (rows: begin, end, numbers, rows, columns, depth) with the arrays of at least ``least`` numbers.

    Returns how many; it stops looking when the table is full. Every byte is looked at most three times, as arrays of
    arrays of arrays are not numbers.
    """
    found = 0
    i = 0
    n = data.shape[0]
    while i < n and found < table.shape[0]:
        c = data[i]
        if c == QUOTE:
            i += 1
            while i < n and data[i] != QUOTE:
                i += 2 if data[i] == BACKSLASH else 1
        elif c == OPEN:
            end, count, rows, columns, depth = _span(data, i)
            if end >= 0:
                if count >= least:
                    table[found, 0] = i
                    table[found, 1] = end
                    table[found, 2] = count
                    table[found, 3] = rows
                    table[found, 4] = columns
                    table[found, 5] = depth
                    found += 1
                i = end - 1
        i += 1
    return found


@cached_njit(
    [
        types.int64(_BYTES, types.int64, types.int64, _POWERS, types.float32[::1]),
        types.int64(_BYTES, types.int64, types.int64, _POWERS, types.float64[::1]),
    ],
    nogil=True,
)
def read_numbers(data, begin, end, powers, out):
    """Reads the array [begin, end) of ``data``, flattened, into ``out``, which has room for exactly its numbers.

    Returns -1, or the position of what JSON does not allow. Numbers are exact for up to 15 digits and small exponents,
    otherwise off by at most a few units in the last place of float64, which is nothing in the float32 they become.
    One loop without calls: each call would count references to the arrays, which costs more than reading a number.
    """
    after_value = False
    after_open = False
    k = 0
    i = begin
    while i < end:
        c = data[i]
        if c == COMMA:
            if not after_value:
                return i
            after_value = after_open = False
            i += 1
            continue
        if c == SPACE or c == NEWLINE or c == RETURN or c == TAB:
            i += 1
            continue
        if c == OPEN:
            if after_value:
                return i
            after_open = True
            i += 1
            continue
        if c == CLOSE:
            if not (after_value or after_open):
                return i
            after_value = True
            after_open = False
            i += 1
            continue
        if after_value or k >= out.shape[0]:
            return i
        # a number: its value in three variables, mantissa * 10^exponent * sign
        start = i
        negative = c == MINUS
        if negative:
            i += 1
            c = data[i]
        if c == UPPER_I:
            for t in range(8):
                if data[i + t] != _INFINITY[t]:
                    return start
            i += 8
            value = np.inf
        elif c == UPPER_N and not negative:
            for t in range(3):
                if data[i + t] != _NAN[t]:
                    return start
            i += 3
            value = np.nan
        else:
            mantissa = np.uint64(0)
            kept = 0
            exponent = 0
            first = i
            while ZERO <= c <= NINE:
                if kept < 19:
                    mantissa = mantissa * np.uint64(10) + np.uint64(c - ZERO)
                    if mantissa:
                        kept += 1
                else:
                    exponent += 1
                i += 1
                c = data[i]
            if i == first or (data[first] == ZERO and i - first > 1):
                return start
            if c == DOT:
                i += 1
                c = data[i]
                first = i
                while ZERO <= c <= NINE:
                    if kept < 19:
                        mantissa = mantissa * np.uint64(10) + np.uint64(c - ZERO)
                        if mantissa:
                            kept += 1
                        exponent -= 1
                    i += 1
                    c = data[i]
                if i == first:
                    return start
            if c == LOWER_E or c == UPPER_E:
                i += 1
                c = data[i]
                down = c == MINUS
                if down or c == PLUS:
                    i += 1
                    c = data[i]
                first = i
                power = 0
                while ZERO <= c <= NINE:
                    if power < 1_000_000:
                        power = power * 10 + (c - ZERO)
                    i += 1
                    c = data[i]
                if i == first:
                    return start
                exponent += -power if down else power
            value = np.float64(mantissa)
            if mantissa and exponent < 0:
                if exponent >= -308:
                    value = value / powers[-exponent]
                elif exponent >= -616:
                    value = value / powers[308] / powers[-308 - exponent]
                else:
                    value = 0.0
            elif mantissa and exponent > 0:
                value = value * powers[exponent] if exponent <= 308 else np.inf
        out[k] = -value if negative else value
        k += 1
        after_value = True
        after_open = False
    return -1 if k == out.shape[0] else end


@cached_njit(types.int64(types.float64[::1], types.uint32[::1], types.float64), nogil=True)
def to_indices(values, out, bound):
    """Whole numbers in [0, bound) into ``out``. Returns -1, or which number is not one."""
    for k in range(values.shape[0]):
        value = values[k]
        if not (value >= 0.0 and value < bound and value == np.floor(value)):
            return k
        out[k] = np.uint32(value)
    return -1


@cached_njit(types.boolean(_SINGLES, types.float32), nogil=True)
def all_within(values, farthest):
    """Whether no value is NaN or farther from 0 than ``farthest``."""
    for begin in range(0, values.shape[0], 1024):
        outside = 0
        for k in range(begin, min(begin + 1024, values.shape[0])):
            outside += not abs(values[k]) <= farthest
        if outside:
            return False
    return True


@cached_njit(types.void(types.float32[::1]), nogil=True)
def to_unit_interval(values):
    """Numbers below 0 become 0, above 1 become 1, NaN becomes 0; in place."""
    for k in range(values.shape[0]):
        value = values[k]
        value = value if value > 0.0 else np.float32(0.0)
        values[k] = value if value < 1.0 else np.float32(1.0)


@cached_njit(_FOUND(_BYTES, _TABLE, types.int64[::1]), nogil=True)
def outline(data, members, commas):
    """Where the members of the JSON object ``data`` are, and the commas between the elements of those that are lists.

    Args:
        members: filled; (n, 5) rows: begin and end of the key with its quotes, begin and end of the value, and how many
            of ``commas`` belong to the members up to this one.
        commas: filled; positions.
    Returns:
        (members, 1), or (0, 0) when the text is not an object, has too many members, or brackets that do not match.
        Nothing inside the values is checked.
    """
    i = 0
    n = data.shape[0]
    depth = 0
    found = 0
    noted = 0
    is_list = False
    key = False
    in_value = False
    begun = False
    hanging = False
    last = 0
    while i < n:
        c = data[i]
        if c == SPACE or c == NEWLINE or c == RETURN or c == TAB:
            i += 1
            continue
        if depth == 0 and (begun or c != BRACE):
            return 0, 0
        begun = True
        begin = i
        if c == QUOTE:
            i += 1
            while i < n and data[i] != QUOTE:
                i += 2 if data[i] == BACKSLASH else 1
            if i >= n:
                return 0, 0
            if depth == 1 and not in_value:
                if key or found >= members.shape[0]:
                    return 0, 0
                key = True
                hanging = False
                members[found, 0] = begin
                members[found, 1] = i + 1
        elif c == OPEN or c == BRACE:
            depth += 1
            if depth == 2:
                if not in_value:
                    return 0, 0
                is_list = c == OPEN
        elif c == CLOSE or c == END_BRACE:
            depth -= 1
            if depth < 0:
                return 0, 0
            if depth == 0:
                if in_value:
                    members[found, 3] = last
                    members[found, 4] = noted
                    found += 1
                    in_value = False
                elif key or hanging:
                    return 0, 0
        elif c == COLON:
            if depth == 1:
                if not key or in_value:
                    return 0, 0
                in_value = True
                key = False
                is_list = False
                members[found, 2] = i + 1
        elif c == COMMA:
            if depth == 1:
                if not in_value:
                    return 0, 0
                members[found, 3] = last
                members[found, 4] = noted
                found += 1
                in_value = False
                hanging = True
            elif depth == 2 and is_list:
                if noted >= commas.shape[0]:
                    return 0, 0
                commas[noted] = i
                noted += 1
        i += 1
        last = i
    return (found, 1) if begun and depth == 0 and not in_value and not key else (0, 0)
