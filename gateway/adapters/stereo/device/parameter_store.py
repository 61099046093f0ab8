"""A stereo camera's parameters in the database, as names and JSON values."""

import sqlite3
from collections.abc import Mapping
from typing import Any

import msgspec
import structlog

from gateway.adapters.stereo.device.parameter_specs import NODES
from gateway.adapters.stereo.device.parameters import Parameters

_log = structlog.get_logger("gateway.state")

Values = Mapping[str, Mapping[str, Any]]
"""Parameter values by node and name; plain JSON values."""


class ParameterStore:
    """Stores the parameters of one camera, by its name; see ``gateway.runtime.state.service.Store``."""

    def __init__(self, camera: str, parameters: Parameters) -> None:
        self._camera, self._parameters = camera, parameters

    def restore(self, connection: sqlite3.Connection) -> Values:
        """Set the stored values; those that this version does not know or accept are logged and skipped.

        Returns all values, so that defaults are not written: a later release may have better ones.
        """
        rows = connection.execute(
            "SELECT node, name, value FROM stereo_parameter WHERE camera = ? ORDER BY node, name", (self._camera,)
        ).fetchall()
        for node, name, value in rows:
            try:
                self._parameters.set(node, [(name, msgspec.json.decode(value))])
            except (LookupError, ValueError) as error:
                _log.warning("stored parameter ignored", camera=self._camera, node=node, reason=str(error))
        return self.capture()

    def capture(self) -> Values:
        """Return a copy of the values."""
        return {node: dict(self._parameters.values(node)) for node in NODES}

    def write(self, connection: sqlite3.Connection, stored: Values, captured: Values) -> bool:
        """Write the values that differ from the stored ones; return False if there are none."""
        rows = [
            (self._camera, node, name, msgspec.json.encode(value).decode())
            for node, values in captured.items()
            for name, value in values.items()
            if stored[node][name] != value
        ]
        connection.executemany("INSERT OR REPLACE INTO stereo_parameter VALUES (?, ?, ?, ?)", rows)
        return bool(rows)
