from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.gateway_process import gateway_process


@pytest.fixture(scope="session")
def gateway_url() -> Iterator[str]:
    """A gateway with every interface and default access; whatever is done to it, its log has no error in the end."""
    flags = ("--lcm-url", "off", "--tcpq-port", "0", "--grpc-port", "0", "--demo", "--stereo-faults")
    with gateway_process(*flags) as (process, url):
        yield url
        assert process.stop() == 0
        assert not [entry for entry in process.rest_of_log() if entry["level"] in ("error", "critical", "raw")]
