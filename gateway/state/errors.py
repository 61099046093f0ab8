"""Why there is no state."""

from __future__ import annotations


class StateError(RuntimeError):
    """The file cannot be used; one sentence that names it. Nothing in it was changed."""
