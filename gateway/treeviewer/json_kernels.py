"""Find and parse long number arrays in JSON text without the GIL.

A mesh or point cloud of 100,000 vertices is 11 MB of digits. Python's JSON readers make a million objects of them in
0.1 to 0.5 s while no other thread runs; these kernels make arrays of them in 30 to 60 ms while others run.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit

_BYTES = types.Array(types.uint8, 1, "C", readonly=True)
_POWERS = types.Array(types.float64, 1, "C", readonly=True)
_TABLE = types.Array(types.int64, 2, "C")
_ARRAY_INFO = types.Tuple((types.int64,) * 5)

QUOTE, BACKSLASH, OPEN, CLOSE, COMMA = ord('"'), ord("\\"), ord("["), ord("]"), ord(",")
MINUS, PLUS, DOT, ZERO, NINE = ord("-"), ord("+"), ord("."), ord("0"), ord("9")
LOWER_E, UPPER_E, UPPER_N, UPPER_I = ord("e"), ord("E"), ord("N"), ord("I")
SPACE, TAB, NEWLINE, RETURN = 32, 9, 10, 13
_NAN: Final = np.frombuffer(b"NaN", np.uint8)
_INFINITY: Final = np.frombuffer(b"Infinity", np.uint8)

RAGGED: Final = -1
"""Number of columns of an array whose rows differ in length."""


def powers_of_ten() -> NDArray[np.float64]:
    """Return 10^0 to 10^308, (309,) float64, each rounded correctly."""
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
"""Kind of each byte in an array of numbers; 0: it cannot be in one. The letters are those of NaN and Infinity, which
Python's json writes."""


@cached_njit(_ARRAY_INFO(_BYTES, types.int64), nogil=True)
def _scan_array(data, begin):
    """Return (end, numbers, rows, columns, depth) of the array that opens at ``begin``.

    ``end`` is -1 if the array has anything else than numbers and rows of numbers. Only kinds of bytes are checked;
    ``read_numbers`` checks the grammar. The last byte of an array is its closing bracket, so ``read_numbers`` can look
    one byte past any number.
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
def find_arrays(data, table, min_numbers):
    """Find the arrays of at least ``min_numbers`` numbers in JSON text, (N,) uint8, and return how many there are.

    ``table``, (M, 6), is filled with rows of begin, end, numbers, rows, columns, depth; the search stops when it is
    full. Each byte is read at most three times, since an array nested deeper than rows is left at its third bracket.
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
            end, count, rows, columns, depth = _scan_array(data, i)
            if end >= 0:
                if count >= min_numbers:
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


@cached_njit(types.int64(_BYTES, types.int64, types.int64, _POWERS, types.float64[::1]), nogil=True)
def read_numbers(data, begin, end, powers, out):
    """Parse the array [begin, end) of ``data``, flattened, into ``out``, whose length is its number of numbers.

    Return -1, or the position of a byte that JSON does not allow. Numbers of up to 15 digits with small exponents are
    exact; others are off by at most a few units in the last place of float64. It is one loop without calls, since Numba
    counts references to the arrays at each call, which costs more than parsing a number.
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
        # the number is mantissa * 10^exponent * sign
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
