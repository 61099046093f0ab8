"""Filtered rows of a picture as blocks of deflate (RFC 1951): repetitions of the pixel to the left, and the rest by
Huffman codes made for each block.

Rendered pictures are flat: filtered with Up, most pixels equal the one to their left. Only such repetitions are looked
for, 64 bytes at a time; what does not repeat is counted and packed four symbols at a time. Several times faster than
a search for strings in a window, and on depth pictures, whose low bytes are noise, as small.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from renderers.encode.bits import put_bits, put_code_lengths
from renderers.encode.huffman import assign_codes, code_lengths
from renderers.encode.runs import END, LENGTHS, LOW, NOTHING, SYMBOLS, find_runs, pieces
from renderers.encode.workarea import CHECKSUM, CODE_LENGTHS, CODES, HEAP, ROW, STATE, TABLES, TOTALS
from renderers.jit import kernel
from renderers.linked import inner
from renderers.pointers import i64_at, u8_at, u16_at, u32_at
from renderers.words import load_word, store_word

_LIMIT: Final = 12
"""Bits of the longest literal code: four of them fit a word, behind the seven bits that may wait."""


@inner
def _filter(pixels: int, above: int, rows: int, row_bytes: int, swap: int, filtered: int) -> None:
    """Each byte minus the one above, behind the filter's number; of 16-bit samples the high byte first."""
    for _ in range(rows):
        u8_at(filtered)[0] = 2
        here, before, f = u8_at(pixels), u8_at(above), u8_at(filtered + 1)
        if swap:
            for j in range(row_bytes >> 1):
                f[2 * j] = np.uint8(here[2 * j + 1] - before[2 * j + 1])
                f[2 * j + 1] = np.uint8(here[2 * j] - before[2 * j])
        else:
            for j in range(row_bytes):
                f[j] = np.uint8(here[j] - before[j])
        above = pixels
        pixels += row_bytes
        filtered += row_bytes + 1


@inner
def _symbols(f: Any, total: int, pixel: int, runs: int, out: Any, work: int) -> None:
    """The block's literals and repetitions, and its end."""
    state, codes, table = i64_at(work + STATE), u32_at(work + CODES), i64_at(work + TABLES)
    parts = u16_at(work + CODES)  # a load costs less than to take two values apart
    symbols = LENGTHS
    word, bits, place = np.uint64(state[0]), state[1], state[2]
    distance = np.uint64(1 if pixel > 1 else 0)  # the second of two codes of one bit, but for distance 1
    longest = np.int64(codes[285])
    repeat = np.uint64(longest & 0xFFFF) | distance << np.uint64(longest >> 16)
    repeat_bits = (longest >> 16) + 1
    repeats = repeat | repeat << np.uint64(repeat_bits)
    repeats |= repeats << np.uint64(2 * repeat_bits)
    i = 0
    for run in range(runs + 1):
        start = table[2 * run] if run < runs else total
        while i + 8 <= start:
            eight = load_word(f, i)
            i += 8
            for _ in range(2):
                a, b = 2 * np.int64(eight & LOW), 2 * np.int64((eight >> np.uint64(8)) & LOW)
                c, d = 2 * np.int64((eight >> np.uint64(16)) & LOW), 2 * np.int64((eight >> np.uint64(24)) & LOW)
                eight >>= np.uint64(32)
                first_bits, second_bits = np.uint64(parts[a + 1]), np.uint64(parts[c + 1])
                left = np.uint64(parts[a]) | np.uint64(parts[b]) << first_bits
                right = np.uint64(parts[c]) | np.uint64(parts[d]) << second_bits
                first_bits += np.uint64(parts[b + 1])
                second_bits += np.uint64(parts[d + 1])
                word |= (left | right << first_bits) << np.uint64(bits)
                bits += np.int64(first_bits + second_bits)
                store_word(out, place, word)
                place += bits >> 3
                word >>= np.uint64(bits & ~7)
                bits &= 7
        while i < start:  # the last few of the block: all others come in eights
            a = codes[f[i]]
            i += 1
            word |= np.uint64(a & 0xFFFF) << np.uint64(bits)
            bits += np.int64(a >> 16)
            store_word(out, place, word)
            place += bits >> 3
            word >>= np.uint64(bits & ~7)
            bits &= 7
        if run == runs:
            break
        length = table[2 * run + 1]
        i += length
        whole, first, last = pieces(length)
        while whole >= 4:
            word |= repeats << np.uint64(bits)
            bits += 4 * repeat_bits
            store_word(out, place, word)
            place += bits >> 3
            word >>= np.uint64(bits & ~7)
            bits &= 7
            whole -= 4
        # From here on nothing branches: how long repetitions are cannot be foreseen.
        some = whole * repeat_bits
        word |= (repeats & ((np.uint64(1) << np.uint64(some)) - np.uint64(1))) << np.uint64(bits)
        bits += some
        store_word(out, place, word)
        place += bits >> 3
        word >>= np.uint64(bits & ~7)
        bits &= 7
        for part in range(2):
            size = first if part == 0 else last
            entry = symbols[size]
            a = np.int64(codes[entry & 0xFFFF])  # no bits for a size of 0
            value = np.uint64(a & 0xFFFF) | np.uint64(entry >> 32) << np.uint64(a >> 16)
            coded = (a >> 16) + ((entry >> 16) & 0xFFFF)
            used = np.int64(size != 0)
            word |= (value | (distance & np.uint64(used)) << np.uint64(coded)) << np.uint64(bits)
            bits += coded + used
        store_word(out, place, word)
        place += bits >> 3
        word >>= np.uint64(bits & ~7)
        bits &= 7
    a = np.int64(codes[END])
    word |= np.uint64(a & 0xFFFF) << np.uint64(bits)
    bits += a >> 16
    store_word(out, place, word)
    state[0], state[1], state[2] = np.int64(word >> np.uint64(bits & ~7)), bits & 7, place + (bits >> 3)


@kernel("int64(int64,int64,int64,int64,int64,int64,int64,int64,int64,int64,int64)")
def deflate_rows(
    pixels: int,
    height: int,
    row_bytes: int,
    pixel: int,
    swap: int,
    top: int,
    step: int,
    filtered: int,
    work: int,
    out: int,
    latest: int,
) -> int:
    """Filters the rows of a picture with Up and writes blocks of them, until all are written or the output is full.

    Args:
        pixels: address of ``height * row_bytes`` bytes.
        pixel: bytes to the left at which repetitions are looked for, 1 .. 4.
        swap: 1: 16-bit samples, little endian; the file has the high byte first.
        top: the row to go on with; 0 begins a stream.
        step: rows of a block.
        filtered: address of ``step * (row_bytes + 1) + PADDING`` bytes, overwritten.
        work: address of ``TABLES`` and as many bytes as are filtered, 8-byte aligned; ``CHECKSUM`` and ``ROW`` tell in
            it how far this came. It must stay as it is between calls for the same stream.
        out: address of the output, which is written from its start.
        latest: where in the output a block may begin at the latest: so that ``room_of(step * (row_bytes + 1))`` follow.

    Returns:
        Whole bytes written; the bits of one that has begun come first at the next call. The last byte of the stream
        is filled with zeros.
    """
    f, o, state = u8_at(filtered), u8_at(out), i64_at(work + STATE)
    lengths, codes = u8_at(work + CODE_LENGTHS), u32_at(work + CODES)
    distances = max(2, pixel)
    if top == 0:
        state[0] = state[1] = 0
        state[CHECKSUM - STATE // 8] = 1
        zeros = u8_at(work + TABLES)  # the row above the first, where repetitions will be written
        for j in range(row_bytes):
            zeros[j] = 0
    state[2] = 0
    while top < height and state[2] <= latest:
        rows = min(step, height - top)
        begin = pixels + top * row_bytes
        _filter(begin, begin - row_bytes if top > 0 else work + TABLES, rows, row_bytes, swap, filtered)
        top += rows
        total = rows * (row_bytes + 1)
        runs = find_runs(f, total, pixel, work)
        literals = code_lengths(i64_at(work + TOTALS), SYMBOLS, _LIMIT, lengths, i64_at(work + HEAP))
        assign_codes(lengths, literals, codes, i64_at(work + HEAP))
        codes[NOTHING] = 0
        for d in range(distances):
            lengths[literals + d] = np.uint8(d == 0 or d == distances - 1)
        put_bits(o, state, int(top == height) | 2 << 1, 3)
        put_code_lengths(o, literals, distances, work)
        _symbols(f, total, pixel, runs, o, work)
        put_bits(o, state, 0, 0)
    state[ROW - STATE // 8] = top
    size: int = state[2]
    if top == height and state[1] > 0:
        size += 1
    return size
