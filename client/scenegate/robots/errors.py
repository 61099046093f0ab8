"""The error of robot files, and name suggestions for its messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Final

from scenegate.warning_text import joined_warnings

MAX_COMPARED_NAMES: Final = 1000
"""Maximum number of names that are compared: each may take 0.1 ms."""
MAX_COMPARED_CHARS: Final = 100
"""Longer names are not compared: the time to compare two names grows with the product of their lengths."""


class RobotFileError(ValueError):
    """A robot file cannot be used. The message names the link or joint; ``read_robot`` adds the robot file's name."""


def no_links(warnings: Sequence[str]) -> RobotFileError:
    """Return the error of a robot without links, with the warnings about those that were left out."""
    return RobotFileError(f"it has no links{': ' if warnings else ''}{joined_warnings(warnings)}")


def name_hint(name: str, names: Iterable[str]) -> str:
    """Return the end of an error message about an unknown name: "; did you mean a, b?", or "; there are a, b, …"."""
    known = list(names)
    similar: list[str] = []
    if 0 < len(name) <= MAX_COMPARED_CHARS:
        compared = known[:MAX_COMPARED_NAMES]
        by_casefolded = {other.casefold(): other for other in compared if len(other) <= MAX_COMPARED_CHARS}
        matches = difflib.get_close_matches(name.casefold(), by_casefolded, n=3, cutoff=0.5)
        similar += [by_casefolded[match] for match in matches]
        similar += [other for other in known if name.casefold() in other.casefold() and other not in similar]
    if similar:
        return f"; did you mean {', '.join(similar[:3])}?"
    if not known:
        return ""
    return f"; there are {', '.join(known[:8])}{', …' if len(known) > 8 else ''}"
