"""Find and parse long number arrays in JSON text without the GIL.

A mesh or point cloud of 100,000 vertices is 11 MB of digits. Python's JSON readers make a million objects of them in
0.1 to 0.5 s while no other thread runs; these kernels make arrays of them in 30 to 60 ms while others run.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.pending import wait_until_compiled
from renderers.compiler.pointers import address_of, f64_at, i64_at, u8_at

QUOTE, BACKSLASH, OPEN, CLOSE, COMMA = ord('"'), ord("\\"), ord("["), ord("]"), ord(",")
MINUS, PLUS, DOT, ZERO, NINE = ord("-"), ord("+"), ord("."), ord("0"), ord("9")
LOWER_E, UPPER_E, UPPER_N, UPPER_I = ord("e"), ord("E"), ord("N"), ord("I")
SPACE, TAB, NEWLINE, RETURN = 32, 9, 10, 13
_NAN: Final = np.frombuffer(b"NaN", np.uint8)
_INFINITY: Final = np.frombuffer(b"Infinity", np.uint8)

RAGGED: Final = -1
"""Number of columns of an array whose rows differ in length."""


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
_POWERS_OF_TEN: Final = np.array([float(f"1e{i}") for i in range(309)])
"""10^0 to 10^308, each rounded correctly."""


def find_arrays(text: NDArray[np.uint8], max_arrays: int, min_numbers: int) -> NDArray[np.int64]:
    """Find the arrays of at least ``min_numbers`` numbers in JSON text; at most ``max_arrays``, the first ones.

    Args:
        text: (N,) uint8.

    Returns:
        (M, 6) int64: begin and end in the text, number of numbers, rows, columns, depth.
    """
    wait_until_compiled("formats")
    table = np.empty((max_arrays, 6), np.int64)
    found = _find_arrays(address_of(text, np.uint8), len(text), address_of(table, np.int64), max_arrays, min_numbers)
    return table[:found]


def read_numbers(text: NDArray[np.uint8], begin: int, end: int, count: int) -> tuple[NDArray[np.float64], int]:
    """Parse the array [begin, end) of JSON text, flattened.

    Numbers of up to 15 digits with small exponents are exact; others are off by at most a few units in the last place
    of float64.

    Args:
        text: (N,) uint8.
        count: number of its numbers.

    Returns:
        (count,) float64, and -1 or the position of a byte that JSON does not allow.
    """
    wait_until_compiled("formats")
    numbers = np.empty(count, np.float64)
    powers_at, numbers_at = address_of(_POWERS_OF_TEN, np.float64), address_of(numbers, np.float64)
    error_at: int = _read_numbers(address_of(text, np.uint8), begin, end, powers_at, numbers_at, count)
    return numbers, error_at


@device_function
def _scan_array(data, size, begin):
    """Return (end, numbers, rows, columns, depth) of the array that opens at ``begin``.

    ``end`` is -1 if the array has anything else than numbers and rows of numbers. Only kinds of bytes are checked;
    ``_read_numbers`` checks the grammar. The last byte of an array is its closing bracket, so ``_read_numbers`` can
    look one byte past any number.
    """
    depth = 0
    deepest = 0
    count = 0
    rows = 0
    columns = -2
    row = 0
    inside = False
    i = begin
    while i < size:
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


@kernel("int64(int64, int64, int64, int64, int64)")
def _find_arrays(text_at, size, table_at, max_arrays, min_numbers):
    """Fill the table of ``find_arrays``, and return its number of rows.

    Each byte is read at most three times, since an array nested deeper than rows is left at its third bracket.
    """
    data, table = u8_at(text_at), i64_at(table_at)
    found = 0
    i = 0
    while i < size and found < max_arrays:
        c = data[i]
        if c == QUOTE:
            i += 1
            while i < size and data[i] != QUOTE:
                i += 2 if data[i] == BACKSLASH else 1
        elif c == OPEN:
            end, count, rows, columns, depth = _scan_array(data, size, i)
            if end >= 0:
                if count >= min_numbers:
                    table[6 * found] = i
                    table[6 * found + 1] = end
                    table[6 * found + 2] = count
                    table[6 * found + 3] = rows
                    table[6 * found + 4] = columns
                    table[6 * found + 5] = depth
                    found += 1
                i = end - 1
        i += 1
    return found


@kernel("int64(int64, int64, int64, int64, int64, int64)")
def _read_numbers(text_at, begin, end, powers_at, out_at, count):
    """Write the ``count`` numbers of an array, and return the second result of ``read_numbers``."""
    data, powers, out = u8_at(text_at), f64_at(powers_at), f64_at(out_at)
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
        if after_value or k >= count:
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
    return -1 if k == count else end
