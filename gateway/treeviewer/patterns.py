"""Clients' subscription patterns, kept from taking forever: a regular expression can be made to run for years."""

from __future__ import annotations

import re
import warnings
from typing import Final

CHARACTERS: Final = 63
"""Of a channel's name at most, so of what a repetition can take."""
MOST_STEPS: Final = CHARACTERS**3
"""Ways in which one pattern may be tried against a channel, about: three repetitions; half a millisecond."""


class PatternError(ValueError):
    """A pattern that cannot be used; the message says why."""


def compile_pattern(pattern: str) -> re.Pattern[str]:
    """The pattern, to be used with ``fullmatch`` (LCM anchors it on both sides).

    Raises:
        PatternError: not a regular expression, or one that could take too long.
    """
    steps_of(pattern)
    try:
        with warnings.catch_warnings():
            # what Python may once take for a nested set is an ordinary character to LCM
            warnings.simplefilter("ignore", FutureWarning)
            return re.compile(pattern)
    except (re.error, OverflowError, RecursionError) as error:
        raise PatternError(f"{pattern!r} is not a regular expression: {error}") from None


def steps_of(pattern: str) -> int:
    """In how many ways a match of ``pattern`` may be tried before it fails, as an upper bound.

    Raises:
        PatternError: in too many, or something in it makes them hard to count.
    """
    steps = 1
    at = 0
    previous = ""
    alternatives = [1]
    """Of the whole and of each group that is open."""
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
        if c == "(":
            alternatives.append(1)
            at += 2 if pattern[at + 1 : at + 2] == "?" else 0
        elif c == "|":
            alternatives[-1] += 1
        elif c == ")" and len(alternatives) > 1:
            steps *= alternatives.pop()
        elif c in "*+{":
            if previous == ")":
                raise PatternError(f"{pattern!r} repeats a group, which is not supported")
            steps *= CHARACTERS
        elif c == "?" and previous not in ("*", "+", "}"):  # behind those it means few rather than many
            steps *= 2
        previous, at = c, at + 1
    steps *= alternatives[0]
    if steps > MOST_STEPS:
        raise PatternError(f"{pattern!r} can be tried in {steps} ways, {MOST_STEPS} are possible")
    return steps
