"""Tree paths as database keys: a node's key starts with its parent's key, so a subtree is a range of keys.

Each path element is a tag (``i``: integer as decimal text, ``s``: text as UTF-8), its length as a big-endian uint32,
and its bytes. Lone surrogates, which JSON allows in names, are encoded as three bytes.
"""

from __future__ import annotations

import struct
from typing import Final

from gateway.scene.tree.nodes import Path, PathElement

SUBTREE_END: Final = b"\x7f"
"""Suffix that is greater than both tags. A subtree has the keys from its root's key (included) to the root's key with
this suffix (excluded)."""
_HEADER: Final = struct.Struct(">cI")


def _element_key(element: PathElement) -> bytes:
    if isinstance(element, str):
        data = element.encode("utf-8", "surrogatepass")
        return _HEADER.pack(b"s", len(data)) + data
    data = b"%d" % element
    return _HEADER.pack(b"i", len(data)) + data


def key_of(path: Path) -> bytes:
    """Return the key of a path; the root's key is empty."""
    return b"".join(map(_element_key, path))


def path_of(key: bytes) -> Path:
    """Return the path of a key.

    Raises:
        ValueError: ``key`` is not a valid key.
    """
    path: list[PathElement] = []
    offset = 0
    while offset < len(key):
        try:
            tag, length = _HEADER.unpack_from(key, offset)
        except struct.error:
            raise ValueError(f"the key {key[:80]!r} ends within an element") from None
        begin, offset = offset + _HEADER.size, offset + _HEADER.size + length
        data = key[begin:offset]
        if len(data) != length or tag not in (b"s", b"i"):
            raise ValueError(f"the key {key[:80]!r} has an invalid element")
        path.append(data.decode("utf-8", "surrogatepass") if tag == b"s" else int(data))
    return tuple(path)
