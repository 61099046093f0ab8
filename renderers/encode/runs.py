"""Repetitions of the pixel to the left: found, counted, and as deflate's lengths (RFC 1951, section 3.2.5)."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from renderers.encode.adler import LARGE, MODULUS, sum_bytes, sum_triples, sum_word, sum_words
from renderers.encode.workarea import COUNTS, STATE, TABLES, TOTALS
from renderers.linked import inlined, inner
from renderers.pointers import i64_at, u32_at
from renderers.words import differing, load_word, low_zeros

SYMBOLS: Final = 288
END: Final = 256
"""The symbol that ends a block."""
LOW: Final = np.uint64(255)
NOTHING: Final = 287
"""A symbol that never occurs: of no length."""
_LONGEST: Final = 258


def _length_symbols() -> Any:
    """(259,) int64: symbol | extra bits << 16 | their value << 32 of each length (section 3.2.5)."""
    table = np.full(259, NOTHING, np.int64)
    base, extra = 3, 0
    for symbol in range(257, 285):
        extra = max(0, (symbol - 261) // 4)
        for offset in range(1 << extra):
            table[base + offset] = symbol | extra << 16 | offset << 32
        base += 1 << extra
    table[_LONGEST] = 285
    return table


LENGTHS: Final = _length_symbols()

_SHORT: Final = np.uint64(0xFFFF)
"""A repetition has 16 bytes or more: a shorter one saves few bits, and costs more than as many literals."""


@inlined
def pieces(length: int) -> tuple[int, int, int]:
    """A repetition as so many of the longest, and up to two others of 3 .. 257 (0: none)."""
    whole, rest = length // _LONGEST, length % _LONGEST
    if rest == 0 or rest >= 3:
        return whole, rest, 0
    return whole - 1, 256, rest + 2


@inner
def find_runs(f: Any, total: int, pixel: int, work: int) -> int:
    """Counts symbols and adds to the checksum; gives how many repetitions there are, whose starts and lengths follow
    the tables.

    A word is taken whole, as literals, or begins a repetition: looking for the byte where one begins would cost more
    time (mispredicted branches) than it saves bytes. Of a repetition the checksum needs only the first bytes and the
    number.
    """
    counts, totals, runs = u32_at(work + COUNTS), i64_at(work + TOTALS), i64_at(work + TABLES)
    state = i64_at(work + STATE)
    first_sum, second_sum = state[3] & 0xFFFF, state[3] >> 16
    symbols = LENGTHS
    found = 0
    for s in range(SYMBOLS):
        totals[s] = 0
    for s in range(8 * 256):
        counts[s] = 0
    i = min(8, total)
    for k in range(i):
        counts[f[k]] += 1
    first_sum, second_sum = sum_bytes(f, 0, i, first_sum, second_sum)
    while i + 16 <= total:  # whether a repetition begins must not depend on what is behind the end
        mask = differing(f, i, i - pixel)
        word = load_word(f, i)
        if mask & _SHORT != 0:
            first_sum, second_sum = sum_word(word, first_sum, second_sum)
            for k in range(8):
                counts[(k << 8) + np.int64(word & LOW)] += 1
                word >>= np.uint64(8)
            i += 8
            if second_sum >= LARGE:
                first_sum, second_sum = first_sum % MODULUS, second_sum % MODULUS
            continue
        j = i
        while mask == 0:  # the next address must not wait for what was compared
            j += 64
            if j >= total:
                break
            mask = differing(f, j, j - pixel)
        j = min(j + (low_zeros(mask) & 63), total)
        if pixel == 3 and word != 0:
            first_sum, second_sum = sum_triples(f, i, j, first_sum, second_sum)
        else:
            first_sum, second_sum = sum_words(f, i, j, first_sum, second_sum)
        if second_sum >= LARGE:
            first_sum, second_sum = first_sum % MODULUS, second_sum % MODULUS
        runs[2 * found] = i
        runs[2 * found + 1] = j - i
        found += 1
        whole, first, last = pieces(j - i)
        totals[285] += whole
        totals[symbols[first] & 0xFFFF] += 1
        totals[symbols[last] & 0xFFFF] += 1
        i = j
    for k in range(i, total):
        counts[f[k]] += 1
    first_sum, second_sum = sum_bytes(f, i, total, first_sum, second_sum)
    state[3] = first_sum % MODULUS | (second_sum % MODULUS) << 16
    for k in range(8):
        for s in range(256):
            totals[s] += np.int64(counts[(k << 8) + s])
    totals[END] = 1
    totals[NOTHING] = 0
    return found
