from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import structlog.testing

from gateway.adapters.stereo.device.parameter_specs import NODES
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.runtime.state.database import Database
from gateway.runtime.state.parameter_store import ParameterStore


@pytest.fixture
def database(tmp_path: Path) -> Any:
    database = Database(tmp_path / "state")
    yield database
    database.close()


def kept(database: Database, camera: str = "0") -> tuple[Parameters, ParameterStore]:
    parameters = Parameters()
    store = ParameterStore(camera, lambda: list(NODES), parameters)
    store.restore(database.connection)
    return parameters, store


def commit(database: Database, store: ParameterStore) -> bool:
    captured = store.capture()
    wrote = store.write(database.connection, captured)
    store.committed(captured)
    return wrote


def test_all_parameters_are_restored(database: Database) -> None:
    parameters, store = kept(database)
    for node, specs in NODES.items():
        for spec in specs.values():
            other = (
                spec.choices[-1] if spec.type == "string" else not spec.default if spec.type == "bool" else spec.maximum
            )
            parameters.set(node, [(spec.name, other)])
    assert commit(database, store)
    assert not commit(database, store)
    again, _ = kept(database)
    assert {node: again.values(node) for node in NODES} == {node: parameters.values(node) for node in NODES}


@pytest.mark.parametrize("control", ["Auto", "Manual", "HDR"])
def test_aliased_parameters_agree_after_restore(database: Database, control: str) -> None:
    parameters, store = kept(database)
    parameters.set("rc_camera", [("exp_control", "Manual")])
    commit(database, store)
    parameters.set("rc_camera", [("exp_control", control)])
    commit(database, store)
    again, _ = kept(database)
    assert again.values("rc_camera")["exp_control"] == control
    assert again.values("rc_camera")["exp_auto"] == (control != "Manual")


def test_defaults_are_stored_only_after_other_values(database: Database) -> None:
    parameters, store = kept(database)
    assert not commit(database, store)
    parameters.set("rc_camera", [("fps", 5)])
    commit(database, store)
    parameters.reset("rc_camera")
    assert commit(database, store)
    assert kept(database)[0].values("rc_camera")["fps"] == 25


def test_unknown_and_invalid_parameters_are_logged_and_skipped(database: Database) -> None:
    database.connection.executemany(
        "INSERT INTO stereo_parameter VALUES ('0', ?, ?, ?)",
        [("rc_camera", "fps", "9"), ("rc_camera", "magic", "1"), ("rc_camera", "gamma", "1e9"), ("nobody", "x", "1")],
    )
    with structlog.testing.capture_logs() as logs:
        parameters, _ = kept(database)
    assert parameters.values("rc_camera")["fps"] == 9
    assert len(logs) == 3


def test_captured_values_are_the_same_object_until_a_parameter_changes(database: Database) -> None:
    parameters, store = kept(database)
    captured = store.capture()
    assert store.capture() is captured
    parameters.set("rc_camera", [("fps", 5)])
    assert store.capture() is not captured
    assert (captured["rc_camera"]["fps"], store.capture()["rc_camera"]["fps"]) == (25, 5)


def test_cameras_have_separate_parameters(database: Database) -> None:
    parameters, store = kept(database, "1")
    parameters.set("rc_camera", [("fps", 5)])
    commit(database, store)
    assert kept(database, "0")[0].values("rc_camera")["fps"] == 25
    assert kept(database, "1")[0].values("rc_camera")["fps"] == 5
