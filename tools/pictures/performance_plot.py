"""The plot of docs/performance.md: the table's times as bars, as SVG without any library.

python -m tools.pictures.performance_plot
"""

import math
import re
from html import escape
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = ROOT / "docs" / "performance.md"
PLOT: Final = ROOT / "docs" / "images" / "performance.svg"
TIME: Final = re.compile(r"(?:([^\d,|][^,|]*?) )?([\d.]+) (ms|s)\b")
"""A time of a cell, after the name of a program, if it has one."""
TITLE_WIDTH, BAR, GAP, SCALE_WIDTH, WIDTH = 360, 15, 12, 380, 900
"""Pixels: the tasks' column, height of a bar, gap between tasks, four decades of the scale, the whole plot."""
SHORTEST: Final = 1.0
"""Time at the left end of the logarithmic scale, milliseconds."""


def times_of(page: str) -> dict[str, list[tuple[str, float]]]:
    """Return programs and milliseconds of each row of the first table whose cells are times; ours comes first."""
    rows: dict[str, list[tuple[str, float]]] = {}
    for task, ours, others in re.findall(r"^\| ([^|]*) \| ([^|]*) \| ([^|]*) \| [^|]* \|$", page, re.MULTILINE):
        found = [*TIME.findall(f"Scenegate {ours}"), *TIME.findall(others)]
        if len(found) > 1 and others.strip():
            rows[re.sub(r"[*`]", "", task)] = [
                (name.strip() or "Scenegate", float(value) * (1e3 if unit == "s" else 1)) for name, value, unit in found
            ]
    return rows


def plot(rows: dict[str, list[tuple[str, float]]]) -> str:
    """Return the SVG: a group of bars for each task, with ours in blue."""
    body: list[str] = []
    top = 2 * GAP
    for task, times in rows.items():
        body.append(f'<text x="{TITLE_WIDTH - 10}" y="{top + 12}" text-anchor="end">{escape(task)}</text>')
        for name, value in times:
            width = max(2.0, SCALE_WIDTH / 4 * math.log10(value / SHORTEST))
            color = "#1f6fb4" if name == "Scenegate" else "#b8bec6"
            label = f"{name} {value:.3g} ms" if value < 1e3 else f"{name} {value / 1e3:.2g} s"
            body.append(f'<rect x="{TITLE_WIDTH}" y="{top}" width="{width:.0f}" height="{BAR - 2}" fill="{color}"/>')
            body.append(f'<text x="{TITLE_WIDTH + width + 6:.0f}" y="{top + 11}">{escape(label)}</text>')
            top += BAR
        top += GAP
    for decade in range(5):
        x = TITLE_WIDTH + SCALE_WIDTH * decade // 4
        body.insert(0, f'<line x1="{x}" x2="{x}" y1="{2 * GAP - 6}" y2="{top}"/>')
        body.append(f'<text x="{x}" y="14" text-anchor="middle">{10**decade:,} ms</text>')
    size = f'width="{WIDTH}" height="{top}"'
    style = "text{font:12px sans-serif;fill:#333}line{stroke:#ddd}"
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {WIDTH} {top}"><style>{style}</style>'
    return "\n".join((head, f'<rect {size} fill="#fff"/>', *body, "</svg>\n"))


if __name__ == "__main__":
    PLOT.write_text(plot(times_of(PAGE.read_text("utf-8"))), "utf-8")
