"""Sentences of errors that join several warnings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

_MAX_JOINED: Final = 3
"""Maximum number of warnings in the sentence of an error."""
NOTHING_DRAWN: Final = "so nothing is drawn"
"""End of a viewer's warning about a geometry that it cannot draw."""
NOTHING_OF_ROBOT: Final = "nothing of the robot is drawn"
"""Sentence about a robot without geometry that can be drawn."""


def joined_warnings(warnings: Sequence[str]) -> str:
    """Return the first warnings, and the number of further ones, as one sentence for an error."""
    more = f"; and {len(warnings) - _MAX_JOINED} more" if len(warnings) > _MAX_JOINED else ""
    return "; ".join(warnings[:_MAX_JOINED]) + more


def strict_refusal(warnings: Sequence[str]) -> str:
    """Return the sentence of the error for warnings that ``--strict`` refuses."""
    return f"{joined_warnings(warnings)} (refused: --strict)"
