"""Clients' subscription patterns, kept from taking forever: a regular expression can be made to run for years."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from typing import Final

CHARACTERS: Final = 63
"""Length of LCM's longest usual channel name (LCM_MAX_CHANNEL_NAME_LENGTH); only TCPQ carries longer ones."""
MOST_STEPS: Final = CHARACTERS**3
"""Ways in which one pattern may be tried against a channel, about: three repetitions; half a millisecond."""


class PatternError(ValueError):
    """A pattern that cannot be used; the message says why."""


@dataclass(frozen=True, slots=True)
class Pattern:
    """A subscription's regular expression and an upper bound of what a match costs."""

    regex: re.Pattern[str]
    choices: int
    """Product of all alternatives and optional parts."""
    repetitions: int

    def steps(self, length: int) -> int:
        """In how many ways a match with a channel of ``length`` characters may be tried before it fails."""
        return self.choices * int(length**self.repetitions)

    def matches(self, channel: str) -> bool:
        """Return whether the whole channel name matches (LCM anchors patterns on both sides)."""
        return self.regex.fullmatch(channel) is not None


def compile_pattern(pattern: str) -> Pattern:
    """A subscription's pattern.

    Raises:
        PatternError: not a regular expression, or one that could take too long.
    """
    choices, repetitions = _branches(pattern)
    steps = choices * int(CHARACTERS**repetitions)
    if steps > MOST_STEPS:
        raise PatternError(f"{pattern!r} can be tried in {steps} ways, {MOST_STEPS} are possible")
    try:
        with warnings.catch_warnings():
            # what Python may once take for a nested set is an ordinary character to LCM
            warnings.simplefilter("ignore", FutureWarning)
            return Pattern(re.compile(pattern), choices, repetitions)
    except (re.error, OverflowError, RecursionError) as error:
        raise PatternError(f"{pattern!r} is not a regular expression: {error}") from None


def _branches(pattern: str) -> tuple[int, int]:
    """The product of all alternatives and optional parts of ``pattern``, and the number of its repetitions.

    Raises:
        PatternError: something in it makes them hard to count.
    """
    choices, repetitions = 1, 0
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
            choices *= alternatives.pop()
        elif c in "*+{":
            if previous == ")":
                raise PatternError(f"{pattern!r} repeats a group, which is not supported")
            repetitions += 1
        elif c == "?" and previous not in ("*", "+", "}"):  # behind those it means few rather than many
            choices *= 2
        previous, at = c, at + 1
    return choices * alternatives[0], repetitions
