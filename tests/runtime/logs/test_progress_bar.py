"""The progress bar of commands, on a terminal and elsewhere."""

import io
import sys

import pytest

from scenegate.cli.progress_bar import progress_bar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def shown(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO, total: float | None, columns: int = 120) -> str:
    """Return what a bar with two updates, two seconds apart, writes."""
    now = [100.0]
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setenv("TERM", "xterm")
    with progress_bar("Playing", "messages", total) as bar:
        monkeypatch.setattr("scenegate.cli.progress_bar.time.monotonic", lambda: now[0])
        bar.update(0, 0)
        now[0] += 2.0
        bar.update(25, 5, note="newest 7")
    return stream.getvalue()


def test_nothing_is_written_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    assert shown(monkeypatch, io.StringIO(), 100) == ""


@pytest.mark.parametrize("total", [100.0, None])
def test_count_and_rate_are_shown_on_a_terminal(monkeypatch: pytest.MonkeyPatch, total: float | None) -> None:
    text = shown(monkeypatch, Terminal(), total)
    for part in ("Playing", "5 messages", "2.5/s", "newest 7"):
        assert part in text


def test_the_figures_are_whole_in_a_narrow_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, Terminal(), 100.0, columns=48)
    for part in ("Playing", "5 messages", "2.5/s", "-:--:--", "newest 7"):
        assert part in text
    assert "…" not in text


def test_the_total_may_be_found_later(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress_bar("Checking", "samples", 1) as bar:
        assert not bar.shown
        bar.update(1, 1, total=10)


def test_a_total_counts_also_if_its_update_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("COLUMNS", "120")
    with progress_bar("Checking", "samples") as bar:
        monkeypatch.setattr("scenegate.cli.progress_bar.time.monotonic", lambda: now[0])
        bar.update(0, 0)
        now[0] += 0.01
        bar.update(0, 0, total=10)
        now[0] += 1.99
        bar.update(5, 5)
    assert "━━━━━━━━━━──────────" in terminal.getvalue()
    assert "0:00:02" in terminal.getvalue()
