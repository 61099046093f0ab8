"""Regular expressions of hub clients, limited in how long a match can take.

Python's regular expressions backtrack: a pattern such as ``(a+)+b`` takes years on a short channel name. Patterns are
therefore restricted to a form whose number of ways to match can be counted.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from typing import Final

CHANNEL_CHARS: Final = 63
"""Longest channel name of LCM's UDP networks (LCM_MAX_CHANNEL_NAME_LENGTH). Only TCPQ carries longer ones."""
MAX_STEPS: Final = CHANNEL_CHARS**3
"""Maximum number of ways to match one pattern with a channel name: three repetitions; half a millisecond."""


class PatternError(ValueError):
    """A pattern that is not supported; the message is the reason."""


@dataclass(frozen=True, slots=True)
class Pattern:
    """A subscription's regular expression and an upper limit of the cost of matching it."""

    regex: re.Pattern[str]
    choices: int
    """Product of the numbers of alternatives in each group and of 2 for each optional part."""
    repetitions: int
    """Number of ``*``, ``+`` and ``{}``; each can match any part of the name."""

    def steps(self, length: int) -> int:
        """Return the maximum number of ways to match a channel name of ``length`` characters."""
        return self.choices * int(length**self.repetitions)

    def matches(self, channel: str) -> bool:
        """Return True if the whole channel name matches (LCM anchors patterns on both sides)."""
        return self.regex.fullmatch(channel) is not None


def compile_pattern(pattern: str) -> Pattern:
    """Compile a subscription's pattern.

    Raises:
        PatternError: it is not a regular expression, or could take too long to match.
    """
    choices, repetitions = _count_branches(pattern)
    steps = choices * int(CHANNEL_CHARS**repetitions)
    if steps > MAX_STEPS:
        raise PatternError(f"{pattern!r} can be tried in {steps} ways, {MAX_STEPS} are possible")
    try:
        with warnings.catch_warnings():
            # characters that a future Python may read as a nested set are ordinary characters in LCM
            warnings.simplefilter("ignore", FutureWarning)
            return Pattern(re.compile(pattern), choices, repetitions)
    except (re.error, OverflowError, RecursionError) as error:
        raise PatternError(f"{pattern!r} is not a regular expression: {error}") from None


def _count_branches(pattern: str) -> tuple[int, int]:
    """Return the product of all alternatives and optional parts of ``pattern``, and its number of repetitions.

    Raises:
        PatternError: it has a construct whose cost is hard to count.
    """
    choices, repetitions = 1, 0
    i = 0
    previous = ""
    alternatives = [1]  # of the whole pattern and of each open group
    while i < len(pattern):
        char = pattern[i]
        if char == "\\":
            if pattern[i + 1 : i + 2].isdigit():
                raise PatternError(f"{pattern!r} refers back to a group, which is not supported")
            previous, i = "\\", i + 2
            continue
        if char == "[":
            end = pattern.find("]", i + (3 if pattern[i + 1 : i + 2] == "^" else 2))
            if end < 0:
                raise PatternError(f"{pattern!r} has a set that does not end")
            previous, i = "[", end + 1
            continue
        if char == "(" and pattern[i + 1 : i + 2] == "?" and pattern[i + 2 : i + 3] != ":":
            raise PatternError(f"{pattern!r} has an extension of groups that is not supported")
        if char == "(":
            alternatives.append(1)
            i += 2 if pattern[i + 1 : i + 2] == "?" else 0
        elif char == "|":
            alternatives[-1] += 1
        elif char == ")" and len(alternatives) > 1:
            choices *= alternatives.pop()
        elif char in "*+{":
            if previous == ")":
                raise PatternError(f"{pattern!r} repeats a group, which is not supported")
            repetitions += 1
        elif char == "?" and previous not in ("*", "+", "}"):  # after a repetition it only makes it lazy
            choices *= 2
        previous, i = char, i + 1
    return choices * alternatives[0], repetitions
