"""Adler-32 (RFC 1950, section 9) of words, and of long repetitions, whose bytes are not all read."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from renderers.linked import inlined, inner
from renderers.words import load_word

MODULUS: Final[int] = 65521
"""Of Adler-32 (RFC 1950, section 9)."""
LARGE: Final[int] = 1 << 40
"""The second sum is reduced from here: what a run or a word adds cannot overflow 63 bits then."""
_EVEN: Final = np.uint64(0x00FF00FF00FF00FF)
_ONES: Final = np.uint64(0x0001000100010001)
_EVEN_WEIGHTS: Final = np.uint64(0x0008000600040002)
_ODD_WEIGHTS: Final = np.uint64(0x0007000500030001)
"""Of the bytes of a word in the second sum, as factors: the products' highest 16 bits are the weighted sum."""


@inlined
def sum_word(word: Any, first: Any, second: Any) -> Any:
    """Adler's sums after the eight bytes of a word."""
    even, odd = word & _EVEN, (word >> np.uint64(8)) & _EVEN
    plain = ((even + odd) * _ONES) >> np.uint64(48)
    weighted = (even * _EVEN_WEIGHTS >> np.uint64(48)) + (odd * _ODD_WEIGHTS >> np.uint64(48))
    return first + np.int64(plain), second + 8 * first + np.int64(weighted)


@inner
def sum_bytes(f: Any, begin: int, end: int, first: Any, second: Any) -> Any:
    """Adler's sums after some bytes."""
    i = begin
    while i + 8 <= end:
        first, second = sum_word(load_word(f, i), first, second)
        i += 8
        if second >= LARGE:
            first, second = first % MODULUS, second % MODULUS
    while i < end:
        first += np.int64(f[i])
        second += first
        i += 1
    return first, second


@inner
def sum_words(f: Any, begin: int, end: int, first: Any, second: Any) -> Any:
    """Adler's sums after bytes that repeat themselves every 8 bytes, one or more; nothing here depends on how many."""
    word = load_word(f, begin)
    plain, weighted = sum_word(word, 0, 0)
    number, rest = (end - begin) >> 3, (end - begin) & 7
    second += 8 * (number * first + plain * (number * (number - 1) // 2)) + number * weighted
    first += number * plain
    plain, weighted = sum_word(word & ((np.uint64(1) << np.uint64(8 * rest)) - np.uint64(1)), 0, 0)
    return first + plain, second + rest * first + weighted - (8 - rest) * plain


@inner
def sum_triples(f: Any, begin: int, end: int, first: Any, second: Any) -> Any:
    """Adler's sums after bytes that repeat themselves every 24 bytes."""
    number = (end - begin) // 24
    plain, weighted = sum_bytes(f, begin, begin + 24, 0, 0) if number > 0 else (0, 0)
    second += 24 * (number * first + plain * (number * (number - 1) // 2)) + number * weighted
    return sum_bytes(f, begin + number * 24, end, first + number * plain, second)
