"""Interfaces that other machines reach, and settings that are refused."""

from pathlib import Path
from typing import Any

import pytest
from structlog.testing import capture_logs

from gateway.runtime.http.security import Security
from gateway.runtime.settings import Settings, SettingsError
from tests.support.certificates import certificate


@pytest.fixture(autouse=True)
def _own_lcm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LCM_DEFAULT_URL", raising=False)


def exposed(**settings: Any) -> dict[str, str]:
    return {name: lacks for name, _, lacks in Security.from_settings(Settings(**settings)).exposed()}


@pytest.fixture
def token(tmp_path: Path) -> Path:
    path = tmp_path / "token"
    path.write_text("0123456789abcdef\n")
    return path


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.0.0.7"])
def test_nothing_is_reachable_by_default(host: str) -> None:
    assert exposed(host=host) == {}


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "10.1.2.3"])
def test_all_reachable_interfaces_are_listed(host: str) -> None:
    found = exposed(host=host, rest_port=0)
    assert list(found) == ["HTTP", "The device's REST interface", "The stereo camera's gRPC", "TCPQ"]
    assert found["HTTP"] == "TLS and a token"


def test_only_running_interfaces_are_listed() -> None:
    assert list(exposed(host="0.0.0.0", only="render")) == ["HTTP"]


def test_tcpq_uses_loopback_with_a_token(token: Path) -> None:
    found = exposed(host="0.0.0.0", http_token_file=token)
    assert "TCPQ" not in found
    assert found["HTTP"] == "TLS"
    assert found["The stereo camera's gRPC"] == "TLS and a token"
    assert "TCPQ" in exposed(host="0.0.0.0", http_token_file=token, tcpq_host="0.0.0.0")
    assert "TCPQ" in exposed(tcpq_host="0.0.0.0")


def test_nothing_is_missing_with_tls_and_token(token: Path, tmp_path: Path) -> None:
    pem, key = certificate(tmp_path)
    both = {"http_certificate": pem, "http_key": key, "grpc_certificate": pem, "grpc_key": key}
    found = exposed(host="0.0.0.0", http_token_file=token, grpc_token_file=token, **both)
    assert found == {"HTTP": "", "The stereo camera's gRPC": ""}


@pytest.mark.parametrize(
    ("url", "listed"),
    [
        ("udpm://239.1.1.1:1?ttl=1", True),
        ("udpm://239.1.1.1:1?ttl=0", False),
        ("udpm://239.1.1.1:1", False),
        ("tcpq://h:1?ttl=1", False),
    ],
)
def test_lcm_beyond_this_machine_is_listed(url: str, listed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    assert list(exposed(lcm_url=url)) == ["LCM"] * listed
    monkeypatch.setenv("LCM_DEFAULT_URL", url)
    assert list(exposed()) == ["LCM"] * listed


def test_open_interfaces_are_logged(token: Path) -> None:
    def log_of(**settings: Any) -> list[tuple[str, str]]:
        with capture_logs() as entries:
            Security.from_settings(Settings(**settings)).log_exposure()
        return [(entry["log_level"], entry["event"]) for entry in entries]

    assert log_of() == []
    event = "HTTP is open to other machines (0.0.0.0 port 1234) without {}; see docs/security.md"
    flags = {"host": "0.0.0.0", "only": "render", "http_port": 1234}
    assert log_of(**flags) == [("warning", event.format("TLS and a token"))]
    assert log_of(**flags, http_token_file=token) == [("warning", event.format("TLS"))]


def test_unusable_files_are_reported_before_any_port_is_open(tmp_path: Path) -> None:
    pem, _ = certificate(tmp_path, "one")
    _, key = certificate(tmp_path, "two")
    with pytest.raises(SettingsError, match="TLS of HTTP cannot use"):
        Security.from_settings(Settings(http_certificate=pem, http_key=key))
    with pytest.raises(SettingsError, match="No such file"):
        Security.from_settings(Settings(http_certificate=pem, http_key=tmp_path / "nowhere"))
    with pytest.raises(SettingsError, match="cannot be read"):
        Security.from_settings(Settings(grpc_token_file=tmp_path / "nowhere"))
    with pytest.raises(ValueError, match="need each other"):
        Settings(http_certificate=pem)
