"""The pages of the documentation, taken apart: prose, code, links."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").glob("*.md")])
_FENCE = re.compile(r"^```(.*?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A fenced piece of code."""

    page: Path
    line: int
    """Of its first line."""
    language: str
    """``python``, ``sh`` ...; empty: none was named."""
    options: tuple[str, ...]
    """What follows: ``notest`` keeps it from being run."""
    code: str

    def __str__(self) -> str:
        return f"{self.page.name}:{self.line}"


def blocks(page: Path) -> list[Block]:
    """All fenced pieces of a page."""
    text = page.read_text("utf-8")
    found: list[Block] = []
    for match in _FENCE.finditer(text):
        language, *options = match[1].split() or [""]
        found.append(Block(page, text.count("\n", 0, match.start()) + 2, language, tuple(options), match[2]))
    return found


def prose(page: Path) -> str:
    """The page without fenced code."""
    return _FENCE.sub("", page.read_text("utf-8"))


def spans(page: Path) -> list[str]:
    """Code within lines of prose."""
    return [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", prose(page))]


def links(page: Path) -> list[str]:
    """Where the page's links and pictures lead."""
    without_code = re.sub(r"`[^`]+`", "", prose(page))
    return re.findall(r"\]\(([^()\s]+(?:\([^()]*\))?)\)", without_code)


def anchors(page: Path) -> set[str]:
    """What can be linked to in a page, as GitHub makes it of the headings."""
    headings = re.findall(r"^#{1,6} (.+)$", prose(page), re.MULTILINE)
    plain = (re.sub(r"[`*]|\[|\]\([^)]*\)", "", heading).strip().lower() for heading in headings)
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain}


def commands(block: Block) -> list[str]:
    """The shell's lines of a block, continued lines joined, comments and prompts removed."""
    joined = re.sub(r"\\\n\s*", " ", block.code)
    return [re.sub(r"\s+#\s.*$", "", line).strip().removeprefix("$ ") for line in joined.splitlines() if line.strip()]
