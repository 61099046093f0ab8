"""The container's health check: its exit code follows /readyz."""

import pytest

from gateway.runtime.http import healthcheck
from tests.runtime.http.answering import answering


@pytest.mark.parametrize(("status", "code"), [(200, 0), (503, 1)])
def test_the_exit_code_follows_readyz(status: int, code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    with answering(lambda path: (status if path == "/readyz" else 404, b"")) as port:
        monkeypatch.setenv("SCENEGATE_HTTP_PORT", str(port))
        assert healthcheck.main() == code


def test_a_closed_port_is_not_ready(monkeypatch: pytest.MonkeyPatch) -> None:
    with answering(lambda path: (200, b"")) as port:
        monkeypatch.setenv("SCENEGATE_HTTP_PORT", str(port))
    assert healthcheck.main() == 1, "the server has stopped"
