"""Result of a request to a tree viewer."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.client.tree.published import Path


@dataclass(frozen=True, slots=True)
class Answer:
    """Result of a request."""

    status: int
    """Status code of the protocol."""
    deleted: tuple[Path, ...] = ()
    """Deleted paths."""
    added: tuple[Path, ...] = ()
    """Paths with new geometry."""
    transformed: tuple[Path, ...] = ()
    """Paths with a new transform."""
    missing: tuple[Path, ...] = ()
    """Paths with a new transform but without geometry at or below them, which this client cannot restore."""
    warnings: tuple[str, ...] = ()
    """One sentence for each irregularity that the viewer tolerated and each geometry that it cannot draw."""
    error: str = ""
    """Reason of the first failure; empty if no command failed."""
