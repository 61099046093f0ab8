"""Filtered rows of a picture as blocks of deflate (RFC 1951): repetitions of the pixel to the left, and the rest by
Huffman codes made for each block.

Rendered pictures are flat: filtered with Up, most pixels equal the one to their left. Only such repetitions are looked
for, 64 bytes at a time; what does not repeat is counted and packed four symbols at a time. Several times faster than
a search for strings in a window, and on depth pictures, whose low bytes are noise, as small.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from renderers.encode.huffman import assign_codes, code_lengths
from renderers.jit import kernel
from renderers.linked import inlined, inner
from renderers.pointers import i64_at, u8_at, u16_at, u32_at
from renderers.words import differing, load_word, low_zeros, store_word

PADDING: Final = 64
"""Bytes after the filtered rows that may be read, and after the output that may be written."""
TABLES: Final = 17456
"""Bytes of the work area that hold tables; behind them are 16 for every repetition, of at least 16 bytes each."""

_SYMBOLS: Final = 288
_END: Final = 256
LOW: Final = np.uint64(255)
_NOTHING: Final = 287
"""A symbol that never occurs: of no length."""
_LONGEST: Final = 258
_LIMIT: Final = 12
"""Bits of the longest literal code: four of them fit a word, behind the seven bits that may wait."""
_ORDER: Final = (16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15)
"""Of the code lengths' code lengths (section 3.2.7)."""
_ORDER_ARRAY: Final = np.array(_ORDER, np.int64)


def _length_symbols() -> Any:
    """(259,) int64: symbol | extra bits << 16 | their value << 32 of each length (section 3.2.5)."""
    table = np.full(259, _NOTHING, np.int64)
    base, extra = 3, 0
    for symbol in range(257, 285):
        extra = max(0, (symbol - 261) // 4)
        for offset in range(1 << extra):
            table[base + offset] = symbol | extra << 16 | offset << 32
        base += 1 << extra
    table[_LONGEST] = 285
    return table


_LENGTHS: Final = _length_symbols()

# Tables in the work area, bytes from its start.
_COUNTS: Final = 0
"""uint32: eight times 256 of literals (one would wait for itself), then, int64, the code lengths' tokens."""
_TOTALS: Final = 8192
"""int64, 288: of the block's symbols."""
_HEAP: Final = 10496
"""int64, 640."""
_CODE_LENGTHS: Final = 15616
"""Bytes, 320: of the literals, then of the distances."""
_CODES: Final = 15936
"""uint32, 288."""
_META_COUNTS: Final = 17088
"""int64, 24: of the code lengths."""
_META_LENGTHS: Final = 17280
"""Bytes, 32."""
_META_CODES: Final = 17312
"""uint32, 24."""
_STATE: Final = 17408
"""int64, 5: bits that wait, how many, where in the output they go, the checksum, and the row."""
CHECKSUM: Final[int] = _STATE // 8 + 3
"""Where in the work area, in words, the Adler-32 of what was filtered so far stands."""
ROW: Final[int] = _STATE // 8 + 4
"""Where the next row to be written stands."""
_MODULUS: Final[int] = 65521
"""Of Adler-32 (RFC 1950, section 9)."""
_LARGE: Final[int] = 1 << 40
"""The second sum is reduced from here: what a run or a word adds cannot overflow 63 bits then."""
_SHORT: Final = np.uint64(0xFFFF)
"""A repetition has 16 bytes or more: a shorter one saves few bits, and costs more than as many literals."""
_EVEN: Final = np.uint64(0x00FF00FF00FF00FF)
_ONES: Final = np.uint64(0x0001000100010001)
_EVEN_WEIGHTS: Final = np.uint64(0x0008000600040002)
_ODD_WEIGHTS: Final = np.uint64(0x0007000500030001)
"""Of the bytes of a word in the second sum, as factors: the products' highest 16 bits are the weighted sum."""


def room_of(size: int) -> int:
    """Bytes that a block of so many filtered ones may take, whatever they are."""
    return size * 3 // 2 + 1024 + 2 * PADDING


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


@inlined
def _pieces(length: int) -> tuple[int, int, int]:
    """A repetition as so many of the longest, and up to two others of 3 .. 257 (0: none)."""
    whole, rest = length // _LONGEST, length % _LONGEST
    if rest == 0 or rest >= 3:
        return whole, rest, 0
    return whole - 1, 256, rest + 2


@inlined
def _sum_word(word: Any, first: Any, second: Any) -> Any:
    """Adler's sums after the eight bytes of a word."""
    even, odd = word & _EVEN, (word >> np.uint64(8)) & _EVEN
    plain = ((even + odd) * _ONES) >> np.uint64(48)
    weighted = (even * _EVEN_WEIGHTS >> np.uint64(48)) + (odd * _ODD_WEIGHTS >> np.uint64(48))
    return first + np.int64(plain), second + 8 * first + np.int64(weighted)


@inner
def _sum_bytes(f: Any, begin: int, end: int, first: Any, second: Any) -> Any:
    """Adler's sums after some bytes."""
    i = begin
    while i + 8 <= end:
        first, second = _sum_word(load_word(f, i), first, second)
        i += 8
        if second >= _LARGE:
            first, second = first % _MODULUS, second % _MODULUS
    while i < end:
        first += np.int64(f[i])
        second += first
        i += 1
    return first, second


@inner
def _sum_words(f: Any, begin: int, end: int, first: Any, second: Any) -> Any:
    """Adler's sums after bytes that repeat themselves every 8 bytes, one or more; nothing here depends on how many."""
    word = load_word(f, begin)
    plain, weighted = _sum_word(word, 0, 0)
    number, rest = (end - begin) >> 3, (end - begin) & 7
    second += 8 * (number * first + plain * (number * (number - 1) // 2)) + number * weighted
    first += number * plain
    plain, weighted = _sum_word(word & ((np.uint64(1) << np.uint64(8 * rest)) - np.uint64(1)), 0, 0)
    return first + plain, second + rest * first + weighted - (8 - rest) * plain


@inner
def _sum_triples(f: Any, begin: int, end: int, first: Any, second: Any) -> Any:
    """Adler's sums after bytes that repeat themselves every 24 bytes."""
    number = (end - begin) // 24
    plain, weighted = _sum_bytes(f, begin, begin + 24, 0, 0) if number > 0 else (0, 0)
    second += 24 * (number * first + plain * (number * (number - 1) // 2)) + number * weighted
    return _sum_bytes(f, begin + number * 24, end, first + number * plain, second)


@inner
def _find_runs(f: Any, total: int, pixel: int, work: int) -> int:
    """Counts symbols and adds to the checksum; gives how many repetitions there are, whose starts and lengths follow
    the tables.

    A word is taken whole, as literals, or begins a repetition: looking for the byte where one begins would cost more
    time (mispredicted branches) than it saves bytes. Of a repetition the checksum needs only the first
    bytes and the number.
    """
    counts, totals, runs = u32_at(work + _COUNTS), i64_at(work + _TOTALS), i64_at(work + TABLES)
    state = i64_at(work + _STATE)
    first_sum, second_sum = state[3] & 0xFFFF, state[3] >> 16
    symbols = _LENGTHS
    found = 0
    for s in range(_SYMBOLS):
        totals[s] = 0
    for s in range(8 * 256):
        counts[s] = 0
    i = min(8, total)
    for k in range(i):
        counts[f[k]] += 1
    first_sum, second_sum = _sum_bytes(f, 0, i, first_sum, second_sum)
    while i + 16 <= total:  # whether a repetition begins must not depend on what is behind the end
        mask = differing(f, i, i - pixel)
        word = load_word(f, i)
        if mask & _SHORT != 0:
            first_sum, second_sum = _sum_word(word, first_sum, second_sum)
            for k in range(8):
                counts[(k << 8) + np.int64(word & LOW)] += 1
                word >>= np.uint64(8)
            i += 8
            if second_sum >= _LARGE:
                first_sum, second_sum = first_sum % _MODULUS, second_sum % _MODULUS
            continue
        j = i
        while mask == 0:  # the next address must not wait for what was compared
            j += 64
            if j >= total:
                break
            mask = differing(f, j, j - pixel)
        j = min(j + (low_zeros(mask) & 63), total)
        if pixel == 3 and word != 0:
            first_sum, second_sum = _sum_triples(f, i, j, first_sum, second_sum)
        else:
            first_sum, second_sum = _sum_words(f, i, j, first_sum, second_sum)
        if second_sum >= _LARGE:
            first_sum, second_sum = first_sum % _MODULUS, second_sum % _MODULUS
        runs[2 * found] = i
        runs[2 * found + 1] = j - i
        found += 1
        whole, first, last = _pieces(j - i)
        totals[285] += whole
        totals[symbols[first] & 0xFFFF] += 1
        totals[symbols[last] & 0xFFFF] += 1
        i = j
    for k in range(i, total):
        counts[f[k]] += 1
    first_sum, second_sum = _sum_bytes(f, i, total, first_sum, second_sum)
    state[3] = first_sum % _MODULUS | (second_sum % _MODULUS) << 16
    for k in range(8):
        for s in range(256):
            totals[s] += np.int64(counts[(k << 8) + s])
    totals[_END] = 1
    totals[_NOTHING] = 0
    return found


@inner
def _put(out: Any, state: Any, value: Any, bits: Any) -> None:
    """Appends up to 32 bits."""
    word = np.uint64(state[0]) | (np.uint64(value) << np.uint64(state[1]))
    store_word(out, state[2], word)
    total = state[1] + bits
    state[0] = np.int64(word >> np.uint64(total & ~7))
    state[1] = total & 7
    state[2] += total >> 3


@inner
def _code_lengths(out: Any, literals: int, distances: int, work: int) -> None:
    """The block's header: its codes' lengths, coded themselves (section 3.2.7)."""
    state, lengths, order = i64_at(work + _STATE), u8_at(work + _CODE_LENGTHS), _ORDER_ARRAY
    tokens, counts = i64_at(work + _COUNTS), i64_at(work + _META_COUNTS)  # symbol | extra bits << 8 | value << 16
    meta, codes = u8_at(work + _META_LENGTHS), u32_at(work + _META_CODES)
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
    code_lengths(counts, 19, 7, meta, i64_at(work + _HEAP))
    assign_codes(meta, 19, codes, i64_at(work + _HEAP))
    last = 19
    while last > 4 and meta[order[last - 1]] == 0:
        last -= 1
    _put(out, state, literals - 257, 5)
    _put(out, state, distances - 1, 5)
    _put(out, state, last - 4, 4)
    for k in range(last):
        _put(out, state, np.int64(meta[order[k]]), 3)
    for k in range(number):
        token = tokens[k]
        code = np.int64(codes[token & 255])
        _put(out, state, code & 0xFFFF, code >> 16)
        _put(out, state, token >> 16, (token >> 8) & 255)


@inner
def _symbols(f: Any, total: int, pixel: int, runs: int, out: Any, work: int) -> None:
    """The block's literals and repetitions, and its end."""
    state, codes, table = i64_at(work + _STATE), u32_at(work + _CODES), i64_at(work + TABLES)
    parts = u16_at(work + _CODES)  # a load costs less than to take two values apart
    symbols = _LENGTHS
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
        whole, first, last = _pieces(length)
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
    a = np.int64(codes[_END])
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
    f, o, state = u8_at(filtered), u8_at(out), i64_at(work + _STATE)
    lengths, codes = u8_at(work + _CODE_LENGTHS), u32_at(work + _CODES)
    distances = max(2, pixel)
    if top == 0:
        state[0] = state[1] = 0
        state[CHECKSUM - _STATE // 8] = 1
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
        runs = _find_runs(f, total, pixel, work)
        literals = code_lengths(i64_at(work + _TOTALS), _SYMBOLS, _LIMIT, lengths, i64_at(work + _HEAP))
        assign_codes(lengths, literals, codes, i64_at(work + _HEAP))
        codes[_NOTHING] = 0
        for d in range(distances):
            lengths[literals + d] = np.uint8(d == 0 or d == distances - 1)
        _put(o, state, int(top == height) | 2 << 1, 3)
        _code_lengths(o, literals, distances, work)
        _symbols(f, total, pixel, runs, o, work)
        _put(o, state, 0, 0)
    state[ROW - _STATE // 8] = top
    size: int = state[2]
    if top == height and state[1] > 0:
        size += 1
    return size
