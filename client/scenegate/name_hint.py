"""Suggestions for names that do not exist, at the end of an error message."""

import difflib
from collections.abc import Iterable
from typing import Final

MAX_COMPARED_NAMES: Final = 1000
"""Maximum number of names that are compared: each may take 0.1 ms."""
MAX_COMPARED_CHARS: Final = 100
"""Longer names are not compared: the time to compare two names grows with the product of their lengths."""


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
