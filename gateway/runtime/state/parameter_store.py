"""A stereo camera's parameters in the database, as names and JSON values."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import msgspec
import structlog

_log = structlog.get_logger("gateway.state")

Values = Mapping[str, Mapping[str, Any]]
"""Parameter values by node and name; plain JSON values."""


class Parameters(Protocol):
    """The parameters of a running camera."""

    @property
    def version(self) -> int:
        """A number that grows with every change."""

    def values(self, node: str) -> Mapping[str, Any]:
        """Return the values of a node by name."""

    def set(self, node: str, values: list[tuple[str, object]]) -> object:
        """Validate and set a node's values. Raises LookupError or ValueError."""


class ParameterStore:
    """Stores the parameters of one camera, by its name; see ``service.Store``."""

    def __init__(self, camera: str, nodes: Callable[[], list[str]], parameters: Parameters) -> None:
        self._camera, self._nodes, self._parameters = camera, nodes, parameters
        self._version = -1
        self._captured: Values = {}
        self._stored: Values = {}

    def capture(self) -> Values:
        """Return a copy of the values; the same object while nothing changes."""
        if self._parameters.version != self._version:
            self._version = self._parameters.version
            self._captured = {node: dict(self._parameters.values(node)) for node in self._nodes()}
        return self._captured

    def write(self, connection: sqlite3.Connection, captured: Values) -> bool:
        """Write the values that changed; return False if there are none."""
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
        """Note that these values are stored."""
        self._stored = captured

    def restore(self, connection: sqlite3.Connection) -> None:
        """Set the stored values. Values that this version does not know or accept are logged and skipped."""
        rows = connection.execute(
            "SELECT node, name, value FROM stereo_parameter WHERE camera = ? ORDER BY node, name", (self._camera,)
        ).fetchall()
        for node, name, value in rows:
            try:
                self._parameters.set(node, [(name, msgspec.json.decode(value))])
            except (LookupError, ValueError) as error:
                _log.warning("stored parameter ignored", camera=self._camera, node=node, reason=str(error))
        self._stored = self.capture()  # so defaults are not written: a later release may have better ones
