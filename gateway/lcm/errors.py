"""Errors of the LCM transports."""

from __future__ import annotations


class LcmUnavailable(RuntimeError):  # noqa: N818 - it is a state of the machine, told in one sentence
    """A transport cannot work here; the message says why and what helps."""
