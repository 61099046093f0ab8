"""A compiled MJCF model: what the child process of ``mjcf`` sends to the program."""

from __future__ import annotations

import msgspec


class CompiledModel(msgspec.Struct):
    """A model in MuJoCo's binary format."""

    model: bytes
    warnings: list[str]
    """The compiler's warnings."""
