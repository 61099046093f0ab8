"""Clients' subscription patterns, kept from taking forever: a regular expression can be made to run for years."""

from __future__ import annotations

import re
import warnings
from typing import Final

MOST_REPEATS: Final = 3
"""Repetitions in one pattern: a match against 63 characters then takes at most 63^3 steps, a few milliseconds."""


class PatternError(ValueError):
    """A pattern that cannot be used; the message says why."""


def compile_pattern(pattern: str) -> re.Pattern[str]:
    """The pattern, to be used with ``fullmatch`` (LCM anchors it on both sides).

    Raises:
        PatternError: not a regular expression, or one that could take too long.
    """
    _check(pattern)
    try:
        with warnings.catch_warnings():
            # what Python may once take for a nested set is an ordinary character to LCM
            warnings.simplefilter("ignore", FutureWarning)
            return re.compile(pattern)
    except (re.error, OverflowError, RecursionError) as error:
        raise PatternError(f"{pattern!r} is not a regular expression: {error}") from None


def _check(pattern: str) -> None:
    repeats = 0
    at = 0
    previous = ""
    while at < len(pattern):
        c = pattern[at]
        if c == "\\":
            if pattern[at + 1 : at + 2].isdigit():
                raise PatternError(f"{pattern!r} refers back to a group, which is not supported")
            previous, at = "\\", at + 2
            continue
        if c == "[":
            end = pattern.find("]", at + (3 if pattern[at + 1 : at + 2] == "^" else 2))
            if end < 0:
                raise PatternError(f"{pattern!r} has a set that does not end")
            previous, at = "[", end + 1
            continue
        if c == "(" and pattern[at + 1 : at + 2] == "?" and pattern[at + 2 : at + 3] != ":":
            raise PatternError(f"{pattern!r} has an extension of groups that is not supported")
        if c == "(" and pattern[at + 1 : at + 2] == "?":
            at += 2
        if c in "*+{":
            if previous == ")":
                raise PatternError(f"{pattern!r} repeats a group, which is not supported")
            repeats += 1
            if repeats > MOST_REPEATS:
                raise PatternError(f"{pattern!r} has more than {MOST_REPEATS} repetitions")
        previous, at = c, at + 1
