"""Warnings of an interface that still hold: ``/healthz`` lists them, and the page shows the interface in yellow."""

from collections.abc import Callable
from typing import Any, Final

MAX_SUBJECTS: Final = 1000
"""Maximum number of subjects with warnings. A new one replaces the oldest."""
MAX_LISTED: Final = 20
"""Maximum number of warnings in a list, and of those kept of one subject. Further ones are only counted."""


class WarningList:
    """Sentences by subject, such as a path, a channel or a file. Not thread-safe: it is used in one event loop only."""

    def __init__(self) -> None:
        self.sentences: dict[Any, tuple[str, ...]] = {}
        """Sentences by subject; those without sentences are not in it."""

    def set(self, subject: Any, *sentences: str) -> None:
        """Replace the warnings about a subject. Without sentences it has none any more."""
        self.sentences.pop(subject, None)
        if not sentences:
            return
        if len(self.sentences) >= MAX_SUBJECTS:
            del self.sentences[next(iter(self.sentences))]
        if len(sentences) > MAX_LISTED:
            sentences = (*sentences[: MAX_LISTED - 1], f"and {len(sentences) - MAX_LISTED + 1} more")
        self.sentences[subject] = sentences

    def remove(self, ended: Callable[[Any], bool]) -> None:
        """Remove the warnings about all subjects for which ``ended`` returns True."""
        self.sentences = {subject: texts for subject, texts in self.sentences.items() if not ended(subject)}

    def listed(self) -> list[str]:
        """Return at most ``MAX_LISTED`` different sentences, newest subject first, and the number of further ones."""
        texts = list(dict.fromkeys(text for texts in reversed(self.sentences.values()) for text in texts))
        more = len(texts) - MAX_LISTED
        return texts[:MAX_LISTED] + ([f"and {more} more"] if more > 0 else [])
