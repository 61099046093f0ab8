"""What can go wrong at start."""

from __future__ import annotations


class TreeViewerUnavailable(RuntimeError):  # noqa: N818 - it is a state of the machine, told in one sentence
    """The tree viewer, or one of its transports, cannot work here; the message says why and what helps."""
