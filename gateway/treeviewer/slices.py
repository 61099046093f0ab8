"""Cuts a big request into many small ones, so that no single step of Python's JSON readers takes long."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from gateway.treeviewer import json_kernels

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
    found, good = json_kernels.outline(np.frombuffer(body, np.uint8), members, commas)
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
        opening = body.find(b"[", begin, end)
        if key not in LISTS or not len(places) or opening < 0 or body[begin:opening].strip():
            yield b"{" + key + b":" + body[begin:end] + b"}", 0
            continue
        head = b"{" + key + b":["
        first, last = opening + 1, body.rindex(b"]", begin, end)
        index = 0
        at, following = first, 0
        while following <= len(places):
            count = int(np.searchsorted(places, at + SLICE_BYTES))
            stop, following = (int(places[count]), count + 1) if count < len(places) else (last, len(places) + 1)
            # nothing between two commas is for the reader to refuse
            yield head + (body[at:stop] if body[at:stop].strip() else b",") + b"]}", index
            at, index = stop + 1, following


_OLDER: Final = {b'"setgeometry"': b'"load"', b'"settransform"': b'"draw"'}
