"""Rows that a bench prints, read back for the table of all benches."""

import pytest

from bench.__main__ import rows_in
from bench.figures import PAGE, ROW, row_of
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


def test_a_row_of_the_page_has_the_figures_of_its_bench() -> None:
    task, command = "frame: colour, depth", "bench.raster"
    rows = [
        at_least("frame, 50k triangles, 640x480", "2.10 ms", "vtk 29 ms; by CPU time 9×", 14.0, 7.0),
        at_least("frame, 50k triangles, 640x480", "2.10 ms", "panda3d 5 ms (least 2×)", 2.5, 1.0),
        at_least("frame, 50k triangles, 1280x960", "4 ms", "vtk 52 ms", 12.0, 7.0),
    ]
    assert row_of(task, command, rows) == f"| {task} | 2.10 ms | vtk 29 ms, panda3d 5 ms | `{command}` |"


def test_the_script_knows_each_row_of_the_page() -> None:
    found = list(ROW.finditer(PAGE.read_text("utf-8")))
    assert len(found) > 10
    for match in found:
        row_of(match["task"], match["command"], [])
