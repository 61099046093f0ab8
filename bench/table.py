"""Tables of results as Markdown. The main one compares a figure with a peer's and with a goal."""

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

COLUMNS = ("what", "ours", "peer", "ratio", "goal", "met")


def heading(*columns: str) -> str:
    """Return the heading and the rule of a table."""
    return f"| {' | '.join(columns)} |\n|{len(columns) * '---|'}"


HEAD = heading(*COLUMNS)


@dataclass(frozen=True, slots=True)
class Row:
    """A result; empty texts for cells without content."""

    what: str
    ours: str
    peer: str = ""
    ratio: str = ""
    goal: str = ""
    met: bool | None = None
    """None: there is no goal, or nothing was measured."""

    def markdown(self) -> str:
        met = "" if self.met is None else "yes" if self.met else "**no**"
        return f"| {self.what} | {self.ours} | {self.peer} | {self.ratio} | {self.goal} | {met} |"


def at_least(what: str, ours: str, peer: str, ratio: float, goal: float, unit: str = "×") -> Row:
    """Return a row whose goal is a minimum of the ratio."""
    return Row(what, ours, peer, f"{ratio:.1f}{unit}", f"≥ {goal:g}{unit}", ratio >= goal)


def at_most(what: str, value: float, goal: float, unit: str, peer: str = "") -> Row:
    """Return a row whose goal is a maximum of our own figure."""
    return Row(what, f"{value:.3g} {unit}", peer, "", f"≤ {goal:g} {unit}", value <= goal)


def skipped(what: str, reason: str) -> Row:
    """Return a row for something that could not be measured."""
    return Row(what, "", f"skipped: {reason}")


def geometric_mean(values: Sequence[float]) -> float:
    """Return the geometric mean of positive numbers."""
    return math.exp(statistics.fmean(map(math.log, values)))


def show(rows: Iterable[Row]) -> None:
    """Print the rows as one table."""
    print(f"\n{HEAD}")
    for row in rows:
        print(row.markdown())
    print(flush=True)
