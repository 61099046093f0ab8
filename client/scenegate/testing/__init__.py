"""A pytest plugin with a running gateway, for users' own integration tests; see ``docs/testing.md``.

Projects load it with ``pytest_plugins = ["scenegate.testing"]``. It imports only pytest until a test uses its fixture
``scenegate``.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from scenegate.testing.gateway import Gateway, GatewayPool

_MARKER = (
    "scenegate(*flags, scene=None, fresh=False): configure the fixture scenegate: flags of 'scenegate serve', a file "
    "to publish, and whether the gateway is a new process that no other test uses"
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the ini settings."""
    parser.addini("scenegate_flags", "flags of 'scenegate serve' for the fixture scenegate", "args", [])
    parser.addini(
        "scenegate_scene", "file that the fixture scenegate publishes (.json, .glb, .gltf, .obj …)", "string", ""
    )
    parser.addini(
        "scenegate_seconds",
        "maximum seconds until a gateway has started or answered a request, compilation of its kernels included",
        "string",
        "300",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker."""
    config.addinivalue_line("markers", _MARKER)


@pytest.fixture(scope="session")
def scenegate_pool(pytestconfig: pytest.Config, tmp_path_factory: pytest.TempPathFactory) -> Iterator[GatewayPool]:
    """The gateways of the test session, one per set of flags. They are stopped when the session ends.

    Until then ``no_proxy`` excludes this machine, for every HTTP and gRPC client of the tests.
    """
    from scenegate.testing.gateway import GatewayPool

    with pytest.MonkeyPatch.context() as environment:
        for name in ("no_proxy", "NO_PROXY"):
            environment.setenv(name, "127.0.0.1,localhost", prepend=",")
        pool = GatewayPool(
            lambda: tmp_path_factory.mktemp("scenegate"), float(pytestconfig.getini("scenegate_seconds"))
        )
        yield pool
        pool.close()


@pytest.fixture
def scenegate(request: pytest.FixtureRequest, scenegate_pool: GatewayPool) -> Iterator[Gateway]:
    """A running gateway on free ports of 127.0.0.1 whose live tree contains the scene only.

    Tests with the same flags share a process. ``@pytest.mark.scenegate`` sets other flags or another scene;
    ``fresh=True`` starts a process for this test alone.
    """
    marker = request.node.get_closest_marker("scenegate")
    options: dict[str, Any] = dict(marker.kwargs) if marker is not None else {}
    fresh, scene = bool(options.pop("fresh", False)), options.pop("scene", None)
    if options:
        raise pytest.UsageError(f"the marker scenegate has no argument {', '.join(options)}")
    flags = [*request.config.getini("scenegate_flags"), *(marker.args if marker is not None else ())]
    if scene:  # relative to the test's file
        path = request.path.parent / scene
    elif default_scene := request.config.getini("scenegate_scene"):
        path = Path(request.config.rootpath) / default_scene
    else:
        path = None
    gateway = scenegate_pool.get(tuple(map(str, flags)), path, fresh=fresh)
    try:
        yield gateway
    finally:
        if fresh:
            gateway.stop()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the gateway's log to the report of a failed test."""
    report = yield
    gateway = getattr(item, "funcargs", {}).get("scenegate")
    if report.failed and gateway is not None:
        report.sections.append(("scenegate log", gateway.log()))
    return report
