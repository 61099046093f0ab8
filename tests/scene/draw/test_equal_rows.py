import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gateway.scene.draw.equal_rows import first_of_equal, first_of_equal_pairs
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
    rows = (np.arange(100_000, dtype=np.uint32) << np.uint32(12)).reshape(-1, 2)
    rows = np.concatenate((rows, rows[::-1]))
    first, set_of_row = first_of_equal(rows)
    expected = len(np.unique(rows, axis=0))
    assert len(first) == expected
    assert (rows[first[set_of_row]] == rows).all()


@given(arrays(np.uint32, st.tuples(st.integers(0, 40), st.just(2)), elements=st.integers(0, 5)))
def test_pairs_are_rows_of_two(pairs: np.ndarray) -> None:
    keys, values = (np.ascontiguousarray(column) for column in pairs.T)
    for result, expected in zip(first_of_equal_pairs(keys, values, 6), first_of_equal(pairs), strict=True):
        np.testing.assert_array_equal(result, expected)


def test_a_key_with_many_values_takes_linear_time() -> None:
    values = np.tile(np.arange(200_000, dtype=np.uint32), 2)
    keys = np.zeros_like(values)
    first, set_of_pair = first_of_equal_pairs(keys, values, 1)
    assert (values[first][set_of_pair] == values).all()


def test_both_are_stopped_by_their_flag() -> None:
    flag = StopFlag()
    flag.set(TimeoutError("stopped"))
    column = np.zeros(3, np.uint32)
    for call in (lambda: first_of_equal(column[:, None]), lambda: first_of_equal_pairs(column, column, 1)):
        with pytest.raises(TimeoutError):
            flag.run(call)
