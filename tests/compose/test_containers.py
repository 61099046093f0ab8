"""The other tests of this folder once more, from a container of their own against one with the gateway."""

from __future__ import annotations

import os
import re
import uuid

import pytest

from tests.support.engines import BASE, Engine, engines
from tests.support.ports import free_ports

pytestmark = [pytest.mark.compose, pytest.mark.slow]

IMAGES = {"scenegate": "Dockerfile", "scenegate-test": "tests/compose/Dockerfile"}
PORTS = ("HTTP_PORT", "TCPQ_PORT", "GRPC_PORT")


@pytest.fixture(scope="module", params=["docker", "podman"])
def engine(request: pytest.FixtureRequest) -> Engine:
    """An engine with both images built from this working tree."""
    if os.environ.get("SCENEGATE_URL"):
        pytest.skip("SCENEGATE_URL names a gateway: these may be the tests in the container")
    found, missing = engines()
    if request.param in missing:
        pytest.skip(missing[request.param])
    chosen = found[request.param]
    if not chosen.has(BASE):
        pytest.skip(f"{chosen.name} cannot pull the base image {BASE}")
    for tag, dockerfile in IMAGES.items():
        built = chosen.build(tag, dockerfile)
        assert built.returncode == 0, built.stderr[-4000:]
    return chosen


def test_the_tests_pass_in_a_container(engine: Engine) -> None:
    project = ("-p", f"scenegate{uuid.uuid4().hex[:8]}", "--profile", "test")
    ports = dict(zip(PORTS, map(str, free_ports(len(PORTS))), strict=True))
    try:
        ran = engine.run_compose(*project, "run", "--rm", "-T", "test", env=ports)
        assert ran.returncode == 0, ran.stdout[-4000:] + ran.stderr[-4000:]
        passed = re.search(r"(\d+) passed", ran.stdout)
        assert passed is not None
        assert int(passed[1]) >= 14, "LCM and the browser were there, too"
    finally:
        ended = engine.run_compose(*project, "down", "-t", "15", "-v", env=ports)
    assert ended.returncode == 0, ended.stderr[-4000:]
