"""Subscriptions of one client of the TCPQ hub: regular expressions, with a limit on the time of their matching.

Python's regular expressions backtrack: a pattern such as ``(a+)+b`` takes years on a short channel name. Patterns must
therefore have a form for which the number of attempts to match can be computed.
"""

import re
import warnings
from dataclasses import dataclass
from typing import Final

from scenegate.lcm.tcpq import MAX_PATTERN_BYTES

CHANNEL_CHARS: Final = 63
"""Maximum length of a channel name in LCM's UDP networks (LCM_MAX_CHANNEL_NAME_LENGTH). TCPQ carries longer ones."""
MAX_STEPS: Final = CHANNEL_CHARS**3
"""Maximum number of steps to match one pattern: those of three repetitions, which take half a millisecond."""
MAX_CLIENT_STEPS: Final = 2 * MAX_STEPS
"""Maximum number of steps to match one channel name with all patterns of one client.

Subscriptions are checked for names of ``CHANNEL_CHARS``. Longer names take more steps, so ``match`` skips the patterns
that exceed the maximum."""
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
    """Compile a subscription's pattern. Raises PatternError if it is none, or matching could take too long."""
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
    """Return ``Pattern.choices`` and ``Pattern.repetitions``. Raises PatternError if the cost cannot be computed."""
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


class Subscriptions:
    """Patterns of one client. A client may subscribe the same pattern several times."""

    def __init__(self, max_patterns: int) -> None:
        self._max_patterns = max_patterns
        self._patterns: dict[str, tuple[Pattern, int]] = {}
        """Pattern and number of subscriptions, by the pattern's text."""
        self._steps = 0
        """Steps to match a channel name of ``CHANNEL_CHARS`` with all patterns."""

    def add(self, text: str) -> Pattern | None:
        """Add a subscription; return its pattern, or None if the client has it already. Raises PatternError."""
        if text in self._patterns:
            pattern, count = self._patterns[text]
            self._patterns[text] = (pattern, count + 1)
            return None
        if len(self._patterns) >= self._max_patterns:
            raise PatternError(f"the client has {self._max_patterns} subscriptions already")
        text_bytes = len(text.encode())
        if text_bytes > MAX_PATTERN_BYTES:
            raise PatternError(f"it has {text_bytes} bytes, {MAX_PATTERN_BYTES} are possible")
        pattern = compile_pattern(text)
        steps = pattern.steps(CHANNEL_CHARS)
        if self._steps + steps > MAX_CLIENT_STEPS:
            raise PatternError(f"the client's patterns take too long to match together with {text!r}")
        self._steps += steps
        self._patterns[text] = (pattern, 1)
        return pattern

    def remove(self, text: str) -> None:
        """Remove one subscription of the pattern ``text``, if there is one."""
        pattern, count = self._patterns.pop(text, (None, 0))
        if pattern is None:
            return
        if count > 1:
            self._patterns[text] = (pattern, count - 1)
        else:
            self._steps -= pattern.steps(CHANNEL_CHARS)

    def match(self, channel: str) -> bool:
        """Return True if one of the patterns matches the channel name."""
        remaining = MAX_CLIENT_STEPS
        for pattern, _ in self._patterns.values():
            steps = pattern.steps(len(channel))
            if steps <= remaining:
                remaining -= steps
                if pattern.regex.fullmatch(channel):
                    return True
        return False
