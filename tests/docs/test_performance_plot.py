"""The plot of docs/performance.md is that of its table."""

from tools.pictures.performance_plot import PAGE, PLOT, plot, times_of


def test_reads_programs_and_times() -> None:
    page = "| task | Scenegate | others | by |\n| `a`, b | 2.1 ms | VTK 29 ms, X (Y) 3.8 s | `x` |\n"
    page += "| c | 60 Hz | d 2 Hz | `y` |\n"
    assert times_of(page) == {"a, b": [("Scenegate", 2.1), ("VTK", 29), ("X (Y)", 3800)]}


def test_the_plot_is_that_of_the_page() -> None:
    rows = times_of(PAGE.read_text("utf-8"))
    assert len(rows) > 5
    assert PLOT.read_text("utf-8") == plot(rows), "python -m tools.pictures.performance_plot draws it anew"
