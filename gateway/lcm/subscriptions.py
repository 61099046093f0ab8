"""Subscriptions of one client of the TCPQ hub, with limits on their number and on the time of matching."""

from __future__ import annotations

from typing import Final

from gateway.lcm.patterns import CHANNEL_CHARS, MAX_STEPS, Pattern, PatternError, compile_pattern
from scenegate.lcm.tcpq import MAX_PATTERN_BYTES

MAX_CLIENT_STEPS: Final = 2 * MAX_STEPS
"""Maximum number of steps to match one channel name with all patterns of one client.

Subscriptions are checked for names of ``CHANNEL_CHARS``. Longer names take more steps, so ``match`` skips the patterns
that exceed the maximum."""


class Subscriptions:
    """Patterns of one client. A client may subscribe the same pattern several times."""

    def __init__(self, max_patterns: int) -> None:
        self._max_patterns = max_patterns
        self._patterns: dict[str, tuple[Pattern, int]] = {}
        """Pattern and number of subscriptions, by the pattern's text."""
        self._steps = 0
        """Steps to match a channel name of ``CHANNEL_CHARS`` with all patterns."""

    def add(self, text: str) -> Pattern | None:
        """Add a subscription; return its pattern, or None if the client has subscribed this pattern before.

        Raises:
            PatternError: the pattern is not supported, or a limit is exceeded.
        """
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
