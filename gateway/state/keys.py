"""Paths as keys of the database: the key of a node begins with the keys of all above it, so that a subtree is a range.

An element is a tag (``i``: an integer as decimal text, ``s``: text as UTF-8), four bytes of length (big endian) and so
many bytes. Lone surrogates, which JSON can bring into a name, keep their three bytes.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Final

from gateway.scene.tree import Path, PathElement

AFTER: Final = b"\x7f"
"""A subtree's keys are those from the node's key to the same with this behind it: greater than both tags."""
_HEAD: Final = struct.Struct(">cI")


@lru_cache(maxsize=65536)  # the same robots move again and again
def element_key(element: PathElement) -> bytes:
    """One element's part of a key."""
    if isinstance(element, str):
        data = element.encode("utf-8", "surrogatepass")
        return _HEAD.pack(b"s", len(data)) + data
    data = b"%d" % element
    return _HEAD.pack(b"i", len(data)) + data


def key_of(path: Path) -> bytes:
    """A path's key; the root's is empty."""
    return b"".join(map(element_key, path))


def path_of(key: bytes) -> Path:
    """The path of a key.

    Raises:
        ValueError: it is not one.
    """
    path: list[PathElement] = []
    at = 0
    while at < len(key):
        try:
            tag, length = _HEAD.unpack_from(key, at)
        except struct.error:
            raise ValueError(f"the key {key[:80]!r} ends within an element") from None
        begin, at = at + _HEAD.size, at + _HEAD.size + length
        data = key[begin:at]
        if len(data) != length or tag not in (b"s", b"i"):
            raise ValueError(f"the key {key[:80]!r} has a broken element")
        path.append(data.decode("utf-8", "surrogatepass") if tag == b"s" else int(data))
    return tuple(path)
