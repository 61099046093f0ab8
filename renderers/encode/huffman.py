"""Huffman codes of limited length, as deflate writes them (RFC 1951, section 3.2.2)."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderers.linked import inner


@inner
def code_lengths(counts: Any, symbols: int, limit: int, lengths: Any, heap: Any) -> int:
    """Lengths of an optimal code, shortened where one would be longer than ``limit``.

    The lengths of Moffat and Katajainen ("In-place calculation of minimum-redundancy codes", 1995) are counted, those
    beyond the limit are moved to it, and others lengthened until the code is complete again (Kraft's sum is one).

    Args:
        counts: pointer to int64, how often each symbol occurs.
        symbols: how many there are; at least one must occur, and no more than ``2 ** limit`` may.
        lengths: pointer to bytes, out: of each symbol's code, 0 where it does not occur.
        heap: pointer to int64 of at least ``2 * symbols + 64``, overwritten.

    Returns:
        One more than the last symbol that occurs.
    """
    used = 0
    last = 0
    for s in range(symbols):
        lengths[s] = 0
        if counts[s] > 0:
            heap[used] = counts[s] * 512 + s
            used += 1
            last = s + 1
    if used == 1:
        lengths[last - 1] = 1
        return last
    # Shell's sort: few symbols, mostly in no order.
    gap = 1
    while gap < used // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, used):
            value = heap[i]
            j = i
            while j >= gap and heap[j - gap] > value:
                heap[j] = heap[j - gap]
                j -= gap
            heap[j] = value
        gap //= 3
    tree = used  # heap[tree + i]: weights, then parents, then depths
    for i in range(used):
        heap[tree + i] = heap[i] >> 9
    heap[tree] += heap[tree + 1]
    root, leaf = 0, 2
    for following in range(1, used - 1):
        if leaf >= used or heap[tree + root] < heap[tree + leaf]:
            heap[tree + following] = heap[tree + root]
            heap[tree + root] = following
            root += 1
        else:
            heap[tree + following] = heap[tree + leaf]
            leaf += 1
        if leaf >= used or (root < following and heap[tree + root] < heap[tree + leaf]):
            heap[tree + following] += heap[tree + root]
            heap[tree + root] = following
            root += 1
        else:
            heap[tree + following] += heap[tree + leaf]
            leaf += 1
    heap[tree + used - 2] = 0
    for following in range(used - 3, -1, -1):
        heap[tree + following] = heap[tree + heap[tree + following]] + 1
    # How many codes there are of each length.
    numbers = 2 * used
    for length in range(64):
        heap[numbers + length] = 0
    available, depth = 1, 0
    root = used - 2
    remaining = used
    while available > 0:
        inner = 0
        while root >= 0 and heap[tree + root] == depth:
            inner += 1
            root -= 1
        leaves = available - inner
        if leaves > 0:
            heap[numbers + min(depth, limit)] += leaves
            remaining -= leaves
        available = 2 * inner
        depth += 1
    # Codes of the limit's length are 1, one bit shorter 2, ... of a sum that must be 2 ** limit.
    total = 0
    for length in range(1, limit + 1):
        total += heap[numbers + length] << (limit - length)
    while total > 1 << limit:
        heap[numbers + limit] -= 1
        for length in range(limit - 1, 0, -1):
            if heap[numbers + length] > 0:
                heap[numbers + length] -= 1
                heap[numbers + length + 1] += 2
                break
        total -= 1
    # The rarest symbols get the longest codes.
    place = 0
    for length in range(limit, 0, -1):
        for _ in range(heap[numbers + length]):
            lengths[heap[place] & 511] = np.uint8(length)
            place += 1
    return last


@inner
def assign_codes(lengths: Any, symbols: int, codes: Any, heap: Any) -> None:
    """Canonical codes, first bit lowest as deflate packs them, with their lengths above.

    Args:
        lengths: pointer to bytes, of each symbol's code.
        codes: pointer to uint32, out: ``code | length << 16``.
        heap: pointer to int64 of at least 64, overwritten.
    """
    for length in range(17):
        heap[length] = 0
    for s in range(symbols):
        heap[lengths[s]] += 1
    heap[0] = 0
    code = 0
    for length in range(1, 17):
        code = (code + heap[length - 1]) << 1
        heap[32 + length] = code
    for s in range(symbols):
        bits = np.int64(lengths[s])
        if bits == 0:
            codes[s] = 0
            continue
        value = heap[32 + bits]
        heap[32 + bits] += 1
        turned = 0
        for _ in range(bits):
            turned = (turned << 1) | (value & 1)
            value >>= 1
        codes[s] = np.uint32(turned | (bits << 16))
