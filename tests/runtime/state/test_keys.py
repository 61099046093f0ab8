from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.runtime.state.keys import SUBTREE_END, key_of, path_of

elements = st.text(st.characters(), max_size=6) | st.integers(-(2**63), 2**63 - 1)
paths = st.lists(elements, max_size=5).map(tuple)


@given(paths)
def test_paths_survive_the_round_trip(path: tuple[str | int, ...]) -> None:
    assert [(type(e), e) for e in path_of(key_of(path))] == [(type(e), e) for e in path]


@given(paths, paths)
def test_key_range_is_the_subtree(path: tuple[str | int, ...], other: tuple[str | int, ...]) -> None:
    for candidate in (other, (*path, *other)):
        below = candidate[: len(path)] == path and list(map(type, candidate[: len(path)])) == list(map(type, path))
        assert (key_of(path) <= key_of(candidate) < key_of(path) + SUBTREE_END) == below


@pytest.mark.parametrize("key", [b"s", b"s\0\0\0\2a", b"x\0\0\0\1a", b"i\0\0\0\1a"])
def test_rejects_invalid_keys(key: bytes) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - whichever way it is found
        path_of(key)
