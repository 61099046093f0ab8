"""Compile the regular expressions by which hub clients subscribe, and refuse those that could take long to match.

Python's regular expressions backtrack: a pattern such as ``(a+)+b`` takes years on a short channel name. Patterns must
therefore have a form for which the number of attempts to match can be computed. ``subscriptions`` uses this number.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from typing import Final

CHANNEL_CHARS: Final = 63
"""Maximum length of a channel name in LCM's UDP networks (LCM_MAX_CHANNEL_NAME_LENGTH). TCPQ carries longer ones."""
MAX_STEPS: Final = CHANNEL_CHARS**3
"""Maximum number of steps to match one pattern: those of three repetitions, which take half a millisecond."""
_SYMBOL: Final = re.compile(r"\\.|\[\^?\]?(?:\\.|[^]\\])*\]?|\(\?:?|.", re.DOTALL)
"""An escaped character; a set, which a ] at its begin does not end; the begin of a group; any other character."""


class PatternError(ValueError):
    """A pattern is not supported; the message is the reason."""


@dataclass(frozen=True, slots=True)
class Pattern:
    """A subscription's regular expression, and the numbers that limit the cost of matching it."""

    regex: re.Pattern[str]
    """Matches whole channel names (``fullmatch``): LCM anchors patterns at both ends."""
    choices: int
    """Product of the number of alternatives in each group, and of 2 for each optional part."""
    repetitions: int
    """Number of ``*``, ``+`` and ``{}``. Each may match any number of characters."""

    def steps(self, length: int) -> int:
        """Return the maximum number of attempts to match a channel name of ``length`` characters."""
        return self.choices * int(length**self.repetitions)


def compile_pattern(pattern: str) -> Pattern:
    """Compile a subscription's pattern.

    Raises:
        PatternError: the text is not a regular expression, or matching could take too long.
    """
    choices, repetitions = _count_choices(pattern)
    try:
        with warnings.catch_warnings():
            # Python warns of characters such as [[ that may get a new meaning; LCM's library gives them none
            warnings.simplefilter("ignore", FutureWarning)
            compiled = Pattern(re.compile(pattern), choices, repetitions)
    except (re.error, OverflowError, RecursionError) as error:
        raise PatternError(f"{pattern!r} is not a regular expression: {error}") from None
    steps = compiled.steps(CHANNEL_CHARS)
    if steps > MAX_STEPS:
        raise PatternError(f"{pattern!r} can be tried in {steps} ways, {MAX_STEPS} are allowed")
    return compiled


def _count_choices(pattern: str) -> tuple[int, int]:
    """Return ``Pattern.choices`` and ``Pattern.repetitions`` of a pattern.

    Raises:
        PatternError: the pattern has a construct whose cost cannot be computed.
    """
    choices, repetitions = 1, 0
    previous = ""
    alternatives = [1]  # numbers of alternatives in the whole pattern and in each open group
    for symbol in _SYMBOL.findall(pattern):
        if symbol[0] == "\\" and symbol[1:].isdigit():
            raise PatternError(f"{pattern!r} refers back to a group, which is not supported")
        if symbol == "(?":
            raise PatternError(f"{pattern!r} has an extension of groups that is not supported")
        if symbol in ("(", "(?:"):
            alternatives.append(1)
        elif symbol == "|":
            alternatives[-1] += 1
        elif symbol == ")" and len(alternatives) > 1:
            choices *= alternatives.pop()
        elif symbol in ("*", "+", "{"):
            if previous == ")":
                raise PatternError(f"{pattern!r} repeats a group, which is not supported")
            repetitions += 1
        elif symbol == "?" and previous not in ("*", "+"):  # after these it only makes the repetition lazy
            choices *= 2
        previous = symbol
    return choices * alternatives[0], repetitions
