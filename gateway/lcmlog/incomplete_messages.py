"""Messages of a log that could not be shown completely."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

MAX_CHANNELS: Final = 100
"""Maximum number of channels whose first reason is kept."""


class IncompleteMessages:
    """Counts messages that could not be shown completely; keeps the first reason of each channel."""

    def __init__(self) -> None:
        self._reasons: dict[str, str] = {}
        self._counts: dict[str, int] = {}
        self.count = 0
        """Number of these messages."""

    def add(self, channel: str, reasons: Sequence[str]) -> None:
        """Count a message with the reasons why it is not shown completely."""
        self.count += 1
        if channel in self._reasons or len(self._reasons) < MAX_CHANNELS:
            self._counts[channel] = self._counts.get(channel, 0) + 1  # first: ``listed`` reads what both have
            self._reasons.setdefault(channel, reasons[0])

    def listed(self) -> list[str]:
        """Return a sentence for each channel."""
        return [
            f"{channel}: messages that are not shown completely: {self._counts[channel]}; the first one: {reason}"
            for channel, reason in tuple(self._reasons.items())  # another thread adds to it
        ]
