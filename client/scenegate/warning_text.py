"""Sentences of errors that join several warnings."""

from collections.abc import Iterable, Sequence
from typing import Final

_MAX_JOINED: Final = 3
"""Maximum number of warnings in the sentence of an error."""
NOTHING_DRAWN: Final = "so nothing is drawn"
"""End of a viewer's warning about a geometry that it cannot draw."""
ONLY_GLOSS: Final = "which changes only gloss"
"""End of a sentence about an extension of a mesh file: a note, which ``--strict`` passes."""
NOTHING_OF_ROBOT: Final = "nothing of the robot is drawn"
"""Sentence about a robot without geometry that can be drawn."""


def joined_warnings(warnings: Sequence[str]) -> str:
    """Return the first warnings, and the number of further ones, as one sentence for an error."""
    more = f"; and {len(warnings) - _MAX_JOINED} more" if len(warnings) > _MAX_JOINED else ""
    return "; ".join(warnings[:_MAX_JOINED]) + more


def warnings_and_notes(sentences: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the different sentences, those that ``--strict`` refuses apart from those that are notes."""
    different = dict.fromkeys(sentences)
    notes = tuple(each for each in different if each.endswith(ONLY_GLOSS))
    return tuple(each for each in different if each not in notes), notes


def strict_refusal(sentences: Iterable[str]) -> str:
    """Return the sentence of the error for warnings that ``--strict`` refuses; empty if it refuses none of them."""
    warnings, _ = warnings_and_notes(sentences)
    return f"{joined_warnings(warnings)} (refused: --strict)" if warnings else ""
