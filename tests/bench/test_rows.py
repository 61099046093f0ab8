"""Rows that a bench prints, read back for the table of all benches."""

import pytest

from bench.__main__ import rows_in
from bench.table import Row, at_least, at_most, show, skipped


def test_every_row_that_a_bench_prints_is_read(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        at_least("frames", "2 ms", "vtk 9 ms", 4.5, 4.0),
        at_least("slower", "2 ms", "vtk 6 ms", 3.0, 4.0),
        at_most("start", 1.5, 2.0, "s"),
        Row("a figure without a goal", "1 ms"),
        skipped("frames against panda3d", "no --peers"),
    ]
    print("Details before the table:\n| no | row |")
    show(rows)
    assert rows_in(capsys.readouterr().out) == rows


def test_output_without_a_table_has_no_rows() -> None:
    assert rows_in("| ours | 1 ms |\n") == []
