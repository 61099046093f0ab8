"""Parses the pages of the documentation: prose, code, links."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
GENERATED = frozenset((ROOT / "docs" / "limits.md", ROOT / "docs" / "reference" / "http.md"))
"""Pages that `make docs` and the site's build write, and that are not committed."""
PAGES = sorted(
    {ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")} - GENERATED
)
_FENCE = re.compile(r"^```(.*?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A fenced code block."""

    page: Path
    line: int
    """Number of the first line."""
    language: str
    """``python``, ``sh`` ...; empty if there is none."""
    options: tuple[str, ...]
    """Words after the language; ``notest`` blocks are not run."""
    code: str

    def __str__(self) -> str:
        return f"{self.page.name}:{self.line}"


def blocks(page: Path) -> list[Block]:
    """Return all code blocks of a page."""
    text = page.read_text("utf-8")
    found: list[Block] = []
    for match in _FENCE.finditer(text):
        language, *options = match[1].split() or [""]
        found.append(Block(page, text.count("\n", 0, match.start()) + 2, language, tuple(options), match[2]))
    return found


def prose(page: Path) -> str:
    """Return the page without code blocks."""
    return _FENCE.sub("", page.read_text("utf-8"))


def spans(page: Path) -> list[str]:
    """Return the inline code of a page."""
    return [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", prose(page))]


def links(page: Path) -> list[str]:
    """Return the targets of links and images."""
    without_code = re.sub(r"`[^`]+`", "", prose(page))
    return re.findall(r"\]\(([^()\s]+(?:\([^()]*\))?)\)", without_code)


def anchors(page: Path) -> set[str]:
    """Return the anchors that GitHub makes of the headings."""
    headings = re.findall(r"^#{1,6} (.+)$", prose(page), re.MULTILINE)
    plain = (re.sub(r"[`*]|\[|\]\([^)]*\)", "", heading).strip().lower() for heading in headings)
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain}


def commands(block: Block) -> list[str]:
    """Return the shell commands of a block, with continued lines joined, without comments and prompts."""
    joined = re.sub(r"\\\n\s*", " ", block.code)
    return [re.sub(r"\s+#\s.*$", "", line).strip().removeprefix("$ ") for line in joined.splitlines() if line.strip()]
