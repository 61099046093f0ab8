"""The plot of the soak: memory, stalls, turns and descriptors over time, as SVG without any library."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

WIDTH: Final = 900
HEIGHT: Final = 190
HEAD: Final = 40
LEFT: Final = 60
RIGHT: Final = 30
BOTTOM: Final = 26
TOP: Final = 26
POINTS: Final = 400
"""Along a line; each is the largest value of its stretch, so that no peak is lost."""
COLORS: Final = ("#1f6fb4", "#d9822b")


@dataclass(frozen=True, slots=True)
class _Panel:
    title: str
    lines: tuple[tuple[str, str], ...]
    """Name of the figure, and what it is called."""
    log: bool = False


PANELS: Final = (
    _Panel("Memory of the gateway, MB", (("rss_mb", "resident"),)),
    _Panel(
        "How late a task that sleeps 1 ms wakes, ms: ours and the machine's",
        (("stall_max_ms", "longest of a second"), ("stall_p99_ms", "99 % of a second")),
        log=True,
    ),
    _Panel(
        "CPU time of the event loop between two such moments, ms: ours alone",
        (("turn_max_ms", "longest of a second"), ("turn_p99_ms", "99 % of a second")),
        log=True,
    ),
    _Panel("Load of the machine: programs that want a core", (("load", "mean of a minute"),)),
    _Panel("Open descriptors, tasks of the event loop", (("files", "descriptors"), ("tasks", "tasks"))),
)


def plot(samples: Sequence[dict[str, float]], title: str = "") -> str:
    """The panels above each other; ``title`` says what was done."""
    begin = samples[0]["t"]
    minutes = [(sample["t"] - begin) / 60.0 for sample in samples]
    body = [f'<text x="{LEFT}" y="20" class="t">{title}</text>']
    for index, panel in enumerate(PANELS):
        lines = [[sample[name] for sample in samples] for name, _ in panel.lines]
        body.append(_drawn(HEAD + index * HEIGHT, panel, minutes, lines))
    size = f'width="{WIDTH}" height="{HEAD + len(PANELS) * HEIGHT}"'
    box = f'viewBox="0 0 {WIDTH} {HEAD + len(PANELS) * HEIGHT}"'
    style = (
        "text{font:12px sans-serif;fill:#333}.t{font-weight:bold}polyline{fill:none;stroke-width:1.2}line{stroke:#ddd}"
    )
    back = f'<rect {size} fill="#fff"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} {box}><style>{style}</style>{back}{"".join(body)}</svg>\n'


def _drawn(top: int, panel: _Panel, x: list[float], lines: list[list[float]]) -> str:
    largest = max(1.0, *(value for line in lines for value in line))
    marks = _decades(largest) if panel.log else _round_marks(largest)
    low, high = marks[0], marks[-1]
    right, last, height = WIDTH - RIGHT, max(x[-1], 1e-9), HEIGHT - TOP - BOTTOM

    def place(value: float) -> float:
        share = math.log(max(value, low) / low) / math.log(high / low) if panel.log else (value - low) / (high - low)
        return top + TOP + height * (1.0 - share)

    found = [f'<text x="{LEFT}" y="{top + 16}">{panel.title}</text>']
    for mark in marks:
        y = place(mark)
        found.append(f'<line x1="{LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>')
        found.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{mark:g}</text>')
    for mark in _round_marks(last):
        if mark <= last * 1.001:
            at = LEFT + (right - LEFT) * mark / last
            unit = " min" if mark else ""
            found.append(f'<text x="{at:.0f}" y="{top + HEIGHT - 10}" text-anchor="middle">{mark:g}{unit}</text>')
    for number, ((_, name), line) in enumerate(zip(panel.lines, lines, strict=True)):
        color = COLORS[number]
        at = right - 150 * (len(lines) - number)
        found.append(
            f'<line x1="{at}" x2="{at + 16}" y1="{top + 12}" y2="{top + 12}" style="stroke:{color};stroke-width:3"/>'
        )
        found.append(f'<text x="{at + 21}" y="{top + 16}">{name}</text>')
        points = " ".join(f"{LEFT + (right - LEFT) * t / last:.0f},{place(v):.1f}" for t, v in _thinned(x, line))
        found.append(f'<polyline points="{points}" stroke="{color}"/>')
    return "".join(found)


def _thinned(x: list[float], y: list[float]) -> list[tuple[float, float]]:
    step = max(1, math.ceil(len(x) / POINTS))
    return [(x[at], max(y[at : at + step])) for at in range(0, len(x), step)]


def _round_marks(largest: float) -> list[float]:
    """0 to ``largest`` or a little more, in four to eight steps that people count in."""
    power = 10.0 ** math.floor(math.log10(largest / 4.0))
    step = next(power * factor for factor in (1, 2, 2.5, 5, 10) if largest / (power * factor) <= 8.0)
    return [step * k for k in range(math.ceil(largest / step - 1e-9) + 1)]


def _decades(largest: float) -> list[float]:
    return [10.0**k for k in range(-1, max(1, math.ceil(math.log10(largest))) + 1)]
