"""Cuts a big request into many small ones, so that no single step of Python's JSON readers takes long."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from gateway.treeviewer import kernels

LEAST_CUT: Final = 256 * 1024
"""Bytes; smaller requests are read in one go within a millisecond."""
SLICE_BYTES: Final = 64 * 1024
"""Of one piece: 0.3 ms of reading."""
MOST_MEMBERS: Final = 64
LISTS: Final = (b'"delete"', b'"setgeometry"', b'"load"', b'"settransform"', b'"draw"')


def pieces(body: bytes) -> Iterator[tuple[bytes, int]] | None:
    """Requests that together say what ``body`` says, each with the index of its first command.

    None: the text is better read as a whole, because it is small, not an object, or has a key twice.
    """
    if len(body) < LEAST_CUT:
        return None
    members = np.empty((MOST_MEMBERS, 5), np.int64)
    commas = np.empty(len(body) // 8 + 16, np.int64)
    found, good = kernels.outline(np.frombuffer(body, np.uint8), members, commas)
    if not good:
        return None
    rows = members[:found].tolist()
    keys = [body[row[0] : row[1]] for row in rows]
    if len(set(keys)) != len(keys) or not all(key.isascii() for key in keys) or any(b"\\" in key for key in keys):
        return None
    return _cut(body, keys, rows, commas)


def _cut(body: bytes, keys: list[bytes], rows: list[list[int]], commas: np.ndarray) -> Iterator[tuple[bytes, int]]:
    noted = 0
    for key, (_, _, begin, end, until) in zip(keys, rows, strict=True):
        places = commas[noted:until]
        noted = until
        if key in (b'"setgeometry"', b'"settransform"') and _OLDER[key] in keys:
            continue  # Director's older key overrides it
        value = body[begin:end].strip()
        if key not in LISTS or not len(places) or not value.startswith(b"["):
            yield b"{" + key + b":" + value + b"}", 0
            continue
        head = b"{" + key + b":["
        first = begin + body[begin:end].index(b"[") + 1
        last = begin + body[begin:end].rindex(b"]")
        if not body[int(places[-1]) + 1 : last].strip():
            yield head + b",]}", 0  # a comma that nothing follows: the reader says so
            continue
        index = 0
        at = first
        while at < last:
            count = int(np.searchsorted(places, at + SLICE_BYTES))
            stop, following = (int(places[count]), count + 1) if count < len(places) else (last, len(places) + 1)
            yield head + body[at:stop] + b"]}", index
            at, index = stop + 1, following


_OLDER: Final = {b'"setgeometry"': b'"load"', b'"settransform"': b'"draw"'}
