from pathlib import Path
from typing import Any

import pytest
import structlog.testing

from gateway.adapters.stereo.device.parameter_specs import NODES
from gateway.adapters.stereo.device.parameter_store import ParameterStore
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.runtime.state.database import Database


@pytest.fixture
def database(tmp_path: Path) -> Any:
    database = Database(tmp_path / "state")
    yield database
    database.close()


class Kept:
    """A camera's parameters and their store."""

    def __init__(self, database: Database, camera: str = "0") -> None:
        self.parameters = Parameters()
        self._connection = database.connection
        self._store = ParameterStore(camera, self.parameters)
        self._stored = self._store.restore(self._connection)

    def commit(self) -> bool:
        before, self._stored = self._stored, self._store.capture()
        return self._store.write(self._connection, before, self._stored)


def test_all_parameters_are_restored(database: Database) -> None:
    kept = Kept(database)
    for node, specs in NODES.items():
        for spec in specs.values():
            other = (
                spec.choices[-1] if spec.type == "string" else not spec.default if spec.type == "bool" else spec.maximum
            )
            kept.parameters.set(node, [(spec.name, other)])
    assert kept.commit()
    assert not kept.commit()
    again = Kept(database).parameters
    assert {node: again.values(node) for node in NODES} == {node: kept.parameters.values(node) for node in NODES}


@pytest.mark.parametrize("control", ["Auto", "Manual", "HDR"])
def test_aliased_parameters_agree_after_restore(database: Database, control: str) -> None:
    kept = Kept(database)
    kept.parameters.set("rc_camera", [("exp_control", "Manual")])
    kept.commit()
    kept.parameters.set("rc_camera", [("exp_control", control)])
    kept.commit()
    again = Kept(database).parameters
    assert again.values("rc_camera")["exp_control"] == control
    assert again.values("rc_camera")["exp_auto"] == (control != "Manual")


def test_defaults_are_stored_only_after_other_values(database: Database) -> None:
    kept = Kept(database)
    assert not kept.commit()
    kept.parameters.set("rc_camera", [("fps", 5)])
    kept.commit()
    kept.parameters.reset("rc_camera")
    assert kept.commit()
    assert Kept(database).parameters.values("rc_camera")["fps"] == 25


def test_unknown_and_invalid_parameters_are_logged_and_skipped(database: Database) -> None:
    database.connection.executemany(
        "INSERT INTO stereo_parameter VALUES ('0', ?, ?, ?)",
        [("rc_camera", "fps", "9"), ("rc_camera", "magic", "1"), ("rc_camera", "gamma", "1e9"), ("nobody", "x", "1")],
    )
    with structlog.testing.capture_logs() as logs:
        parameters = Kept(database).parameters
    assert parameters.values("rc_camera")["fps"] == 9
    assert len(logs) == 3


def test_cameras_have_separate_parameters(database: Database) -> None:
    kept = Kept(database, "1")
    kept.parameters.set("rc_camera", [("fps", 5)])
    kept.commit()
    assert Kept(database, "0").parameters.values("rc_camera")["fps"] == 25
    assert Kept(database, "1").parameters.values("rc_camera")["fps"] == 5
