import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gateway.scene.draw.equal_rows import first_of_equal
from renderers.stop import StopFlag

BITS = 0, 1, 2, 1 << 31, (1 << 32) - 1
SHAPES = st.tuples(st.integers(0, 40), st.integers(1, 3))


@given(arrays(np.uint32, SHAPES, elements=st.sampled_from(BITS)))
def test_rows_of_a_set_are_equal_and_sets_are_ordered_by_their_first_rows(rows: np.ndarray) -> None:
    first, set_of_row = first_of_equal(rows)
    expected, inverse = np.unique(rows, axis=0, return_inverse=True)
    assert len(first) == len(expected)
    assert (np.diff(first) > 0).all()
    assert (rows[first][set_of_row] == rows).all()
    assert (set_of_row[first] == np.arange(len(first))).all()
    assert len(set(zip(set_of_row.tolist(), inverse.ravel().tolist(), strict=True))) == len(first)


def test_many_rows_that_differ_in_high_bits_only() -> None:
    rows = (np.arange(100_000, dtype=np.uint32) << 12).reshape(-1, 2)
    rows = np.concatenate((rows, rows[::-1]))
    first, set_of_row = first_of_equal(rows)
    expected = len(np.unique(rows, axis=0))
    assert len(first) == expected
    assert (rows[first[set_of_row]] == rows).all()


def test_is_stopped_by_its_flag() -> None:
    flag = StopFlag()
    flag.set(TimeoutError("stopped"))
    with pytest.raises(TimeoutError):
        flag.run(lambda: first_of_equal(np.zeros((3, 3), np.uint32)))
