"""What every bench prints: rows of one table, a figure of ours, one of a peer, the ratio, the goal, and whether it is
met."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

HEAD = "| what | ours | peer | ratio | goal | met |"


@dataclass(frozen=True, slots=True)
class Row:
    """One line; empty texts where there is nothing to say."""

    what: str
    ours: str
    peer: str = ""
    ratio: str = ""
    goal: str = ""
    met: bool | None = None
    """None: there is no goal, or it could not be measured."""

    def markdown(self) -> str:
        met = "" if self.met is None else "yes" if self.met else "**no**"
        return f"| {self.what} | {self.ours} | {self.peer} | {self.ratio} | {self.goal} | {met} |"


def at_least(what: str, ours: str, peer: str, ratio: float, goal: float, unit: str = "×") -> Row:
    """A row whose goal is a ratio."""
    return Row(what, ours, peer, f"{ratio:.1f}{unit}", f"≥ {goal:g}{unit}", ratio >= goal)


def at_most(what: str, value: float, goal: float, unit: str, peer: str = "") -> Row:
    """A row whose goal is a bound of our own figure."""
    return Row(what, f"{value:.3g} {unit}", peer, "", f"≤ {goal:g} {unit}", value <= goal)


def skipped(what: str, reason: str) -> Row:
    """A row that could not be measured."""
    return Row(what, "", f"skipped: {reason}")


def geometric_mean(values: Sequence[float]) -> float:
    """Of positive numbers."""
    return math.exp(statistics.fmean(map(math.log, values)))


def show(rows: Iterable[Row]) -> None:
    """Prints the table as Markdown."""
    print(f"\n{HEAD}\n|---|---|---|---|---|---|")
    for row in rows:
        print(row.markdown())
    print(flush=True)
