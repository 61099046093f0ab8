"""Settings of hypothesis, kernels and the summary of a run, and the gateway that tests of several rooms share."""

import gc
import os
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

os.environ["SCENEGATE_CHECK_KERNELS"] = "1"  # before kernels are imported, here and in processes of the tests
os.environ.pop("PYTHONUNBUFFERED", None)  # processes of the tests buffer their output, as users' do

from tests.support import clients
from tests.support.gateway_process import gateway_process

# A busy machine is no fault of what is tested: hypothesis' own limits are 200 ms an example and a minute to make them.
settings.register_profile("scenegate", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("scenegate")

HOW_TO_GET = {
    "SCENEGATE_CORPUS": "a folder of recorded requests of real clients",
    "SCENEGATE_DRAKE_PYTHON": "an interpreter with Drake 1.51.1; .ci/run makes one",
    "SCENEGATE_NEW_DRAKE_PYTHON": "an interpreter with Drake 1.58.0; .ci/run makes one",
    "SCENEGATE_RAY_PYTHON": "an interpreter with scenegate[ray]; .ci/run makes one",
    "SCENEGATE_ROBOTS": "a folder with packages of robot files; .ci/run makes one",
    "SCENEGATE_SCHEMATHESIS": "the command `st` of Schemathesis; .ci/run installs it",
    "SCENEGATE_TORCH_PYTHON": "an interpreter with torch and pillow",
    "SCENEGATE_FIDELITY": "a checkout of KhronosGroup/glTF-Render-Fidelity",
    "SCENEGATE_ASSET_GENERATOR": "a checkout of bghgary/glTF-Asset-Generator",
    "SCENEGATE_DIRECTOR": "a checkout of Director",
}
"""Environment variables that the reasons of skipped tests name, and what each has to name."""


LONGEST = (
    "compose/test_image.py",
    "datasets/test_ray.py",
    "drake/test_looks.py",
    "packaging/test_versions.py",
    "security/test_schemathesis.py",
)
"""Files with tests of more than half a minute."""


def pytest_configure(config: pytest.Config) -> None:
    """Compile the kernels before processes that share the tests start: each would compile those that it needs."""
    if getattr(config.option, "numprocesses", None):  # None in those processes themselves
        from gateway.runtime.kernels import cache, parts

        if not cache.are_cached(parts.PARTS):
            print("Compiling the kernels, once for all processes: a minute ...", flush=True)
            parts.ensure_compiled()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the longest tests first: at the end, one process would run such a test while the others have none."""
    items.sort(key=lambda item: not str(item.path).endswith(LONGEST))


def pytest_collection_finish() -> None:
    """Exempt modules and tests from garbage collection, which many tests ask for: their million objects stay anyway."""
    gc.freeze()


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Say what was left out and how to get it, one line for each kind."""
    reasons = [report.longrepr[2].removeprefix("Skipped: ") for report in terminalreporter.stats.get("skipped", ())]
    kinds: Counter[str] = Counter()
    for reason in reasons:
        named = re.search(r"SCENEGATE_\w+", reason)
        variable = named.group() if named else ""
        kinds[f"{variable}: {HOW_TO_GET[variable]}" if variable in HOW_TO_GET else reason] += 1
    if config.option.markexpr == "not slow":
        terminalreporter.write_line("left out: the slow tests (make test-all)")
    for kind, count in sorted(kinds.items()):
        terminalreporter.write_line(f"skipped: {count} ({kind})")


@dataclass(frozen=True, slots=True)
class DemoGateway:
    """Addresses of a running gateway."""

    url: str
    """``http://127.0.0.1:port``"""
    grpc: str
    """``127.0.0.1:port``"""
    tcpq: str
    """``127.0.0.1:port``"""


@pytest.fixture(scope="session")
def demo_gateway() -> Iterator[DemoGateway]:
    """A gateway with every interface, the demo scene and default access; its log must have no error in the end.

    A start takes seconds, so tests share it unless they need other flags or an empty scene.
    """
    flags = ("--lcm-url", "off", "--tcpq-port", "0", "--grpc-port", "0", "--demo", "--stereo-faults")
    with gateway_process(*flags) as (process, url):
        interfaces = clients.get(f"{url}/healthz").json()["interfaces"]
        tcpq = interfaces["treeviewer"]["tcpq"]["url"].removeprefix("tcpq://")
        yield DemoGateway(url, f"127.0.0.1:{interfaces['stereo']['port']}", tcpq)
        assert process.stop() == 0
        assert not [entry for entry in process.rest_of_log() if entry["level"] in ("error", "critical", "raw")]
