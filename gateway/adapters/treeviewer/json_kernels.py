"""Find and parse long number arrays in JSON text without the GIL.

A mesh or point cloud of 100,000 vertices is 11 MB of digits. Python's JSON readers need 0.1 to 0.5 s for a million
Python objects, and hold the GIL. These kernels parse the same text to float64 arrays in 30 to 60 ms without the GIL.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F64, I64, U8, U64, Address, Pointer, ReadOnly1, f64, u64
from renderers.compiler.pointers import address_of, f64_at, i64_at, u8_at

QUOTE, BACKSLASH, OPEN_BRACKET, CLOSE_BRACKET, COMMA = ord('"'), ord("\\"), ord("["), ord("]"), ord(",")
MINUS, PLUS, DOT, ZERO, NINE = ord("-"), ord("+"), ord("."), ord("0"), ord("9")
LOWER_E, UPPER_E, UPPER_N, UPPER_I, LOWER_N = ord("e"), ord("E"), ord("N"), ord("I"), ord("n")
SPACE, TAB, NEWLINE, CARRIAGE_RETURN = ord(" "), ord("\t"), ord("\n"), ord("\r")
_NAN: Final = np.frombuffer(b"NaN", np.uint8)
_INFINITY: Final = np.frombuffer(b"Infinity", np.uint8)
_NULL: Final = np.frombuffer(b"null", np.uint8)

MIXED_COLUMNS: Final = -1
"""Column count of an array whose rows differ in length."""
NO_COLUMNS: Final = -2
"""Column count of an array without rows."""
OTHER_BYTE, NUMBER_BYTE, SEPARATOR_BYTE, OPEN_BYTE, CLOSE_BYTE = range(5)
"""Classes of bytes. A number array contains no OTHER_BYTE."""


def _classify_bytes() -> NDArray[np.uint8]:
    """Return the class of each byte value, (256,)."""
    byte_class = np.full(256, OTHER_BYTE, np.uint8)
    byte_class[list(b"0123456789+-.eE")] = NUMBER_BYTE
    byte_class[list(b"NaNInfinity")] = NUMBER_BYTE  # Python's json writes NaN and Infinity
    byte_class[list(b"null")] = NUMBER_BYTE  # JSON.jl and nlohmann/json write null for NaN
    byte_class[list(b", \n\r\t")] = SEPARATOR_BYTE
    byte_class[OPEN_BRACKET], byte_class[CLOSE_BRACKET] = OPEN_BYTE, CLOSE_BYTE
    return byte_class


_BYTE_CLASS: Final = _classify_bytes()
_POWERS_OF_TEN: Final = np.array([float(f"1e{i}") for i in range(309)])
"""10^0 to 10^308, each rounded correctly."""
MAX_MANTISSA_DIGITS: Final = 19
"""Digits that always fit into uint64."""
MAX_EXPONENT: Final = 1_000_000
"""Exponents saturate here: the number is 0 or infinite."""
COLUMN_COUNT: Final = 6
BEGIN, END, NUMBERS, ROWS, COLUMNS, DIMENSIONS = range(COLUMN_COUNT)
"""Columns of the table of ``_find_arrays``: the fields of ``TextArray``."""
NOT_HERE: Final = -1
"""Position after a text that is not valid."""


class TextArray(NamedTuple):
    """An array of numbers, or of rows of numbers, in JSON text."""

    begin: int
    """Position of the first byte."""
    end: int
    """Position of the byte after the last."""
    number_count: int
    rows: int
    columns: int
    """Columns of an array of two dimensions, or ``MIXED_COLUMNS``; ``NO_COLUMNS`` for one dimension."""
    dimensions: int
    """1 or 2."""


def find_arrays(text: NDArray[np.uint8], max_arrays: int, min_numbers: int) -> list[TextArray]:
    """Return the first ``max_arrays`` arrays in JSON text, (N,) uint8, that have at least ``min_numbers`` numbers."""
    table = np.empty((max_arrays, COLUMN_COUNT), np.int64)
    found = _find_arrays(address_of(text, np.uint8), len(text), address_of(table, np.int64), max_arrays, min_numbers)
    return [TextArray(*row) for row in table[:found].tolist()]


def read_numbers(text: NDArray[np.uint8], begin: int, end: int, count: int) -> tuple[NDArray[np.float64], int]:
    """Parse the ``count`` numbers of the array at ``begin`` to before ``end`` in JSON text, (N,) uint8.

    ``null`` is NaN. Numbers of up to 15 digits, the last between 10^-22 and 10^22, are exact. Other numbers are off by
    at most a few units in the last place of float64.

    Returns the numbers, and the position of the first byte that is not valid JSON or -1.
    """
    numbers = np.empty(count, np.float64)
    powers_at, numbers_at = address_of(_POWERS_OF_TEN, np.float64), address_of(numbers, np.float64)
    error_at: int = _read_numbers(address_of(text, np.uint8), begin, end, powers_at, numbers_at, count)
    return numbers, error_at


@device_function
def _scan_array(data: Pointer[U8], size: I64, begin: I64) -> tuple[I64, I64, I64, I64, I64]:
    """Return (end, count, rows, columns, dimensions) of the array whose opening bracket is at ``begin``.

    See ``TextArray`` for the values. ``end`` is -1 if the array contains anything but numbers and rows of numbers.
    This function checks only the classes of bytes; ``_read_numbers`` checks the grammar.
    """
    depth = 0
    dimensions = 0
    count = 0
    rows = 0
    columns = NO_COLUMNS
    row_length = 0
    in_number = False
    i = begin
    while i < size:
        byte_class = _BYTE_CLASS[data[i]]
        if byte_class == NUMBER_BYTE:
            if not in_number:
                if depth != dimensions:
                    break
                in_number = True
                count += 1
                row_length += 1
        elif byte_class == SEPARATOR_BYTE:
            in_number = False
        elif byte_class == OPEN_BYTE:
            depth += 1
            if in_number or depth > 2 or (depth > dimensions and count > 0):
                break
            dimensions = max(dimensions, depth)
            row_length = 0
        elif byte_class == CLOSE_BYTE:
            in_number = False
            depth -= 1
            if depth == 0:
                return i + 1, count, rows, columns, dimensions
            rows += 1
            if columns == NO_COLUMNS:
                columns = row_length
            elif columns != row_length:
                columns = MIXED_COLUMNS
        else:
            break
        i += 1
    return -1, 0, 0, 0, 0


@kernel
def _find_arrays(text_at: Address, size: I64, table_at: Address, max_arrays: I64, min_numbers: I64) -> I64:
    """Write a table of arrays, and return their number.

    Each byte is read at most three times: ``_scan_array`` stops where brackets are nested three deep.
    """
    data, table = u8_at(text_at), i64_at(table_at)
    found = 0
    i = 0
    while i < size and found < max_arrays:
        byte = data[i]
        if byte == QUOTE:
            i += 1
            while i < size and data[i] != QUOTE:
                i += 2 if data[i] == BACKSLASH else 1
        elif byte == OPEN_BRACKET:
            end, count, rows, columns, dimensions = _scan_array(data, size, i)
            if end >= 0:
                if count >= min_numbers:
                    row = COLUMN_COUNT * found
                    table[row + BEGIN] = i
                    table[row + END] = end
                    table[row + NUMBERS] = count
                    table[row + ROWS] = rows
                    table[row + COLUMNS] = columns
                    table[row + DIMENSIONS] = dimensions
                    found += 1
                i = end - 1
        i += 1
    return found


@kernel
def _read_numbers(text_at: Address, begin: I64, end: I64, powers_at: Address, numbers_at: Address, count: I64) -> I64:
    """Write the ``count`` numbers of an array; return the position of the first byte that is not valid JSON, or -1.

    The array ends with a bracket, so the byte after any number is inside of the text.
    """
    data, powers_of_ten, numbers = u8_at(text_at), f64_at(powers_at), f64_at(numbers_at)
    after_value = False
    after_open = False
    k = 0
    i = begin
    while i < end:
        byte = data[i]
        if byte == SPACE or byte == NEWLINE or byte == CARRIAGE_RETURN or byte == TAB:
            i += 1
        elif byte == COMMA:
            if not after_value:
                return i
            after_value = after_open = False
            i += 1
        elif byte == OPEN_BRACKET:
            if after_value:
                return i
            after_open = True
            i += 1
        elif byte == CLOSE_BRACKET:
            if not (after_value or after_open):
                return i
            after_value, after_open = True, False
            i += 1
        else:
            if after_value or k >= count:
                return i
            numbers[k], after_number = _number_at(data, i, powers_of_ten)
            if after_number == NOT_HERE:
                return i
            k += 1
            i = after_number
            after_value, after_open = True, False
    return -1 if k == count else end


@inlined
def _number_at(data: Pointer[U8], i: I64, powers_of_ten: Pointer[F64]) -> tuple[F64, I64]:
    """Return the number that starts at a position, and the position after it or NOT_HERE. ``null`` is NaN."""
    negative = data[i] == MINUS
    if negative:
        i += 1
    byte = data[i]
    if byte == UPPER_I:
        value, end = np.inf, _end_of_word(data, i, _INFINITY)
    elif byte == UPPER_N and not negative:
        value, end = np.nan, _end_of_word(data, i, _NAN)
    elif byte == LOWER_N and not negative:
        value, end = np.nan, _end_of_word(data, i, _NULL)
    else:
        mantissa, exponent, end = _decimal_at(data, i)
        value = _scaled(mantissa, exponent, powers_of_ten)
    return -value if negative else value, end


@inlined
def _end_of_word(data: Pointer[U8], i: I64, word: ReadOnly1[np.uint8]) -> I64:
    """Return the position after a word that starts at ``i``, or NOT_HERE."""
    for k in range(len(word)):
        if data[i + k] != word[k]:
            return NOT_HERE
    return i + len(word)


@inlined
def _decimal_at(data: Pointer[U8], i: I64) -> tuple[U64, I64, I64]:
    """Return mantissa, exponent and end of a number without sign, mantissa * 10^exponent; the end may be NOT_HERE."""
    integer_at = i
    mantissa, mantissa_digits, exponent, i = _digits_at(data, integer_at, u64(0), 0)
    if i == integer_at or (data[integer_at] == ZERO and i - integer_at > 1):
        return mantissa, 0, NOT_HERE
    if data[i] == DOT:
        fraction_at = i + 1
        mantissa, _, skipped_digits, i = _digits_at(data, fraction_at, mantissa, mantissa_digits)
        if i == fraction_at:
            return mantissa, 0, NOT_HERE
        exponent -= i - fraction_at - skipped_digits  # digits after the point that are in the mantissa
    if data[i] == LOWER_E or data[i] == UPPER_E:
        i += 1
        negative = data[i] == MINUS
        if negative or data[i] == PLUS:
            i += 1
        magnitude_at = i
        magnitude = 0
        while ZERO <= data[i] <= NINE:
            if magnitude < MAX_EXPONENT:
                magnitude = magnitude * 10 + (data[i] - ZERO)
            i += 1
        if i == magnitude_at:
            return mantissa, 0, NOT_HERE
        exponent += -magnitude if negative else magnitude
    return mantissa, exponent, i


@inlined
def _digits_at(data: Pointer[U8], i: I64, mantissa: U64, mantissa_digits: I64) -> tuple[U64, I64, I64, I64]:
    """Append the digits from a position on to a mantissa, as far as it has room.

    Returns the mantissa, its digits without leading zeros, those that had no room, and the position after all digits.
    """
    skipped_digits = 0
    while ZERO <= data[i] <= NINE:
        if mantissa_digits < MAX_MANTISSA_DIGITS:
            mantissa = mantissa * u64(10) + u64(data[i] - ZERO)
            if mantissa:
                mantissa_digits += 1
        else:
            skipped_digits += 1
        i += 1
    return mantissa, mantissa_digits, skipped_digits, i


@inlined
def _scaled(mantissa: U64, exponent: I64, powers_of_ten: Pointer[F64]) -> F64:
    """Return mantissa * 10^exponent."""
    value = f64(mantissa)
    if not mantissa or exponent == 0:
        return value
    if exponent > 0:
        return value * powers_of_ten[exponent] if exponent <= 308 else np.inf
    if exponent >= -308:
        return value / powers_of_ten[-exponent]
    return value / powers_of_ten[308] / powers_of_ten[-308 - exponent] if exponent >= -616 else 0.0
