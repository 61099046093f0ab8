"""The container's health check: its exit code follows /readyz."""

import pytest

from gateway.runtime.http import healthcheck
from tests.support.http_stub import http_server


@pytest.mark.parametrize(("status", "code"), [(200, 0), (503, 1)])
def test_the_exit_code_follows_readyz(status: int, code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    with http_server(lambda request: (status if request.path == "/readyz" else 404, b"")) as url:
        monkeypatch.setenv("SCENEGATE_HTTP_PORT", url.rpartition(":")[2])
        assert healthcheck.main() == code


def test_a_closed_port_is_not_ready(monkeypatch: pytest.MonkeyPatch) -> None:
    with http_server(lambda _: (200, b"")) as url:
        monkeypatch.setenv("SCENEGATE_HTTP_PORT", url.rpartition(":")[2])
    assert healthcheck.main() == 1, "the server has stopped"
