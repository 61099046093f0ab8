"""The plot of the soak: memory and stalls over time, as SVG without any library."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

WIDTH: Final = 900
HEIGHT: Final = 220
LEFT: Final = 70
BOTTOM: Final = 30
TOP: Final = 28


def plot(samples: Sequence[dict[str, float]]) -> str:
    """Three panels above each other: memory; stalls of the event loop; tasks and descriptors."""
    panels = (
        ("Memory (RSS), MB", ("rss_mb",), False),
        ("Stall of the event loop in each second, ms (p99, longest)", ("stall_p99_ms", "stall_max_ms"), True),
        ("Tasks, open files", ("tasks", "files"), False),
    )
    begin = samples[0]["t"]
    minutes = [(sample["t"] - begin) / 60.0 for sample in samples]
    body = [
        _panel(index * HEIGHT, title, minutes, [[sample[name] for sample in samples] for name in names], log=log)
        for index, (title, names, log) in enumerate(panels)
    ]
    size = f'width="{WIDTH}" height="{len(panels) * HEIGHT}"'
    style = "text{font:12px sans-serif;fill:#333}polyline{fill:none;stroke-width:1.2}"
    back = f'<rect {size} fill="#fff"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}><style>{style}</style>{back}{"".join(body)}</svg>\n'


def _panel(top: int, title: str, x: list[float], lines: list[list[float]], *, log: bool) -> str:
    values = [value for line in lines for value in line]
    low, high = (0.1, max(1.0, *values)) if log else (0.0, max(1.0, *values) * 1.1)
    right, last = WIDTH - 15, max(x[-1], 1e-9)
    height = HEIGHT - TOP - BOTTOM

    def place(value: float) -> float:
        share = math.log(max(value, low) / low) / math.log(high / low) if log else (value - low) / (high - low)
        return top + TOP + height * (1.0 - share)

    found = [f'<text x="{LEFT}" y="{top + 18}">{title}</text>']
    marks = [10.0**k for k in range(-1, 5) if 10.0**k <= high] if log else [high * k / 4 for k in range(5)]
    for mark in marks:
        y = place(mark)
        found.append(f'<line x1="{LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ddd"/>')
        found.append(
            f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{mark:g}</text>'
            if log
            else f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{mark:.0f}</text>'
        )
    for k in range(7):
        at = LEFT + (right - LEFT) * k / 6
        found.append(f'<text x="{at:.0f}" y="{top + HEIGHT - 12}" text-anchor="middle">{last * k / 6:.1f}</text>')
    found.append(f'<text x="{right}" y="{top + HEIGHT - 1}" text-anchor="end">minutes</text>')
    for line, color in zip(lines, ("#1f6fb4", "#d9822b"), strict=False):
        points = " ".join(
            f"{LEFT + (right - LEFT) * t / last:.1f},{place(v):.1f}" for t, v in zip(x, line, strict=True)
        )
        found.append(f'<polyline points="{points}" stroke="{color}"/>')
    return "".join(found)
