"""Bits of deflate blocks, and their headers: the lengths of a block's codes."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from renderers.encode.huffman import assign_codes, code_lengths
from renderers.encode.workarea import CODE_LENGTHS, COUNTS, HEAP, META_CODES, META_COUNTS, META_LENGTHS, STATE
from renderers.linked import inner
from renderers.pointers import i64_at, u8_at, u32_at
from renderers.words import store_word

_ORDER: Final = (16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15)
"""Of the code lengths' code lengths (section 3.2.7)."""
_ORDER_ARRAY: Final = np.array(_ORDER, np.int64)


@inner
def put_bits(out: Any, state: Any, value: Any, bits: Any) -> None:
    """Appends up to 32 bits."""
    word = np.uint64(state[0]) | (np.uint64(value) << np.uint64(state[1]))
    store_word(out, state[2], word)
    total = state[1] + bits
    state[0] = np.int64(word >> np.uint64(total & ~7))
    state[1] = total & 7
    state[2] += total >> 3


@inner
def put_code_lengths(out: Any, literals: int, distances: int, work: int) -> None:
    """The block's header: its codes' lengths, coded themselves (section 3.2.7)."""
    state, lengths, order = i64_at(work + STATE), u8_at(work + CODE_LENGTHS), _ORDER_ARRAY
    tokens, counts = i64_at(work + COUNTS), i64_at(work + META_COUNTS)  # symbol | extra bits << 8 | value << 16
    meta, codes = u8_at(work + META_LENGTHS), u32_at(work + META_CODES)
    for i in range(19):
        counts[i] = 0
    number = i = 0
    while i < literals + distances:
        value = np.int64(lengths[i])
        length = 1
        while i + length < literals + distances and lengths[i + length] == value:
            length += 1
        i += length
        if value != 0:
            tokens[number] = value
            counts[value] += 1
            number += 1
            length -= 1
        while length >= 3:
            if value != 0:
                step = min(length, 6)
                symbol, extra, base = 16, 2, 3
            elif length < 11:
                step = length
                symbol, extra, base = 17, 3, 3
            else:
                step = min(length, 138)
                symbol, extra, base = 18, 7, 11
            tokens[number] = symbol | extra << 8 | (step - base) << 16
            counts[symbol] += 1
            number += 1
            length -= step
        for _ in range(length):
            tokens[number] = value
            counts[value] += 1
            number += 1
    code_lengths(counts, 19, 7, meta, i64_at(work + HEAP))
    assign_codes(meta, 19, codes, i64_at(work + HEAP))
    last = 19
    while last > 4 and meta[order[last - 1]] == 0:
        last -= 1
    put_bits(out, state, literals - 257, 5)
    put_bits(out, state, distances - 1, 5)
    put_bits(out, state, last - 4, 4)
    for k in range(last):
        put_bits(out, state, np.int64(meta[order[k]]), 3)
    for k in range(number):
        token = tokens[k]
        code = np.int64(codes[token & 255])
        put_bits(out, state, code & 0xFFFF, code >> 16)
        put_bits(out, state, token >> 16, (token >> 8) & 255)
