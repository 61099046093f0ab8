"""Parameters of a device in the database: names and values, whatever they mean."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import msgspec
import structlog

_log = structlog.get_logger("gateway.state")

Values = Mapping[str, Mapping[str, Any]]
"""By node and name; plain JSON values."""


class Settable(Protocol):
    """What keeps the parameters while the process lives."""

    @property
    def version(self) -> int:
        """Grows with every change."""

    def values(self, node: str) -> Mapping[str, Any]:
        """Of one node, by name."""

    def set(self, node: str, values: list[tuple[str, object]]) -> object:
        """Checks and takes values. Raises LookupError or ValueError, with a sentence."""


class ParameterStore:
    """The parameters of one camera: ``restore`` at start, then as ``TreeStore``."""

    def __init__(self, camera: str, nodes: Callable[[], list[str]], parameters: Settable) -> None:
        self._camera = camera
        self._nodes = nodes
        self._parameters = parameters
        self._version = -1
        self._captured: Values = {}
        self._stored: Values = {}

    def capture(self) -> Values:
        """What ``write`` gets; a copy, the same while nothing changes."""
        if self._parameters.version != self._version:
            self._version = self._parameters.version
            self._captured = {node: dict(self._parameters.values(node)) for node in self._nodes()}
        return self._captured

    def write(self, connection: sqlite3.Connection, captured: Values) -> bool:
        """Brings the table to ``captured`` within the caller's transaction; returns whether anything was to do."""
        if captured is self._stored:
            return False
        rows = [
            (self._camera, node, name, msgspec.json.encode(value).decode())
            for node, values in captured.items()
            for name, value in values.items()
            if self._stored.get(node, {}).get(name) != value
        ]
        connection.executemany("INSERT OR REPLACE INTO stereo_parameter VALUES (?, ?, ?, ?)", rows)
        return bool(rows)

    def committed(self, captured: Values) -> None:
        """The transaction has succeeded."""
        self._stored = captured

    def restore(self, connection: sqlite3.Connection) -> int:
        """Sets what was stored; what this version does not know or allow is told in the log and left at its default.

        Returns:
            how many values were set.
        """
        rows = connection.execute(
            "SELECT node, name, value FROM stereo_parameter WHERE camera = ? ORDER BY node, name", (self._camera,)
        ).fetchall()
        count = 0
        for node, name, value in rows:
            try:
                self._parameters.set(node, [(name, msgspec.json.decode(value))])
                count += 1
            except (LookupError, ValueError) as error:
                _log.warning("A stored parameter was not taken", camera=self._camera, node=node, reason=str(error))
        self._stored = self.capture()  # defaults are not written: a later version may have better ones
        return count
