"""Messages of a log that could not be shown completely."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

MAX_CHANNELS: Final = 100
"""Maximum number of channels whose first reason is kept."""


class IncompleteMessages:
    """Counts messages that could not be shown completely; keeps the first reason of each channel."""

    def __init__(self) -> None:
        self._channels: dict[str, tuple[str, int]] = {}
        """First reason, and number of these messages, by channel."""
        self.count = 0
        """Number of these messages."""

    def add(self, channel: str, reasons: Sequence[str]) -> None:
        """Count a message with the reasons why it is not shown completely."""
        self.count += 1
        reason, count = self._channels.get(channel, (reasons[0], 0))
        if count or len(self._channels) < MAX_CHANNELS:
            self._channels[channel] = reason, count + 1

    def listed(self) -> list[str]:
        """Return a sentence for each channel."""
        return [
            f"{channel}: messages that are not shown completely: {count}; the first one: {reason}"
            for channel, (reason, count) in tuple(self._channels.items())  # another thread adds to it
        ]
