"""The pytest plugin: the fixture ``scenegate``. Nothing but pytest is imported until a test asks for it."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from gateway.testing.running import Gateway, Pool

_MARKER = (
    "scenegate(*flags, scene=None, fresh=False): flags of 'scenegate serve', a file to publish and whether the test "
    "has a gateway to itself, for the fixture scenegate"
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Settings of the project's tests."""
    parser.addini("scenegate_flags", "flags of 'scenegate serve' for the fixture scenegate", "args", [])
    parser.addini(
        "scenegate_scene", "file that the fixture scenegate publishes (.json, .glb, .gltf, .obj …)", "string", ""
    )
    parser.addini("scenegate_seconds", "for a gateway to start, compiling its kernels included", "string", "300")


def pytest_configure(config: pytest.Config) -> None:
    """Makes the marker known."""
    config.addinivalue_line("markers", _MARKER)


@pytest.fixture(scope="session")
def scenegate_pool(pytestconfig: pytest.Config, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pool]:
    """The gateways of this session, one for each different set of flags; stopped in the end."""
    from gateway.testing.running import Pool

    pool = Pool(lambda: tmp_path_factory.mktemp("scenegate"), float(pytestconfig.getini("scenegate_seconds")))
    yield pool
    pool.close()


@pytest.fixture
def scenegate(request: pytest.FixtureRequest, scenegate_pool: Pool) -> Iterator[Gateway]:
    """A running gateway on free ports of 127.0.0.1 whose tree has the scene and nothing else.

    The process is shared by all tests with the same flags; ``@pytest.mark.scenegate`` gives others, another scene, or
    with ``fresh=True`` a process for this test alone.
    """
    marker = request.node.get_closest_marker("scenegate")
    options: dict[str, Any] = dict(marker.kwargs) if marker is not None else {}
    fresh, scene = bool(options.pop("fresh", False)), options.pop("scene", None)
    if options:
        raise pytest.UsageError(f"the marker scenegate has no {', '.join(options)}")
    flags = [*request.config.getini("scenegate_flags"), *(marker.args if marker is not None else ())]
    root = Path(request.config.rootpath)
    named = scene or request.config.getini("scenegate_scene")
    path = (request.path.parent if scene else root) / named if named else None
    gateway = scenegate_pool.lend(tuple(map(str, flags)), path, fresh=fresh)
    try:
        yield gateway
    finally:
        if fresh:
            gateway.stop()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A failed test shows what the gateway logged during it."""
    report = yield
    gateway = getattr(item, "funcargs", {}).get("scenegate")
    if report.failed and gateway is not None:
        report.sections.append(("scenegate log", gateway.log()))
    return report
