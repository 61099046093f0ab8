"""The error that ends the start of a gateway with ``--state``."""

from __future__ import annotations


class StateError(RuntimeError):
    """The state file cannot be used. The message is one sentence with the file's path; the file is unchanged."""
