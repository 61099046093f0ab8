"""Addresses of gateways, and errors of requests to them: sentences without the system's numbers."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import pytest

from scenegate.credentials import Credentials
from scenegate.gateway_http import GatewayError, GatewayRequestError, fetch, parse_address
from tests.support.certificates import certificate


@pytest.mark.parametrize(
    ("address", "parts"),
    [
        ("http://robot:8000", ("robot", 8000, "")),
        ("http://robot/view#eye=1,2,3", ("robot", None, "")),
        ("http://[::1]:80/cell/1/view?theme=dark", ("::1", 80, "/cell/1")),
    ],
)
def test_addresses(address: str, parts: tuple[str, int | None, str]) -> None:
    assert parse_address(address, Credentials())[:3] == parts


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("robot:8000", "the address of the gateway is 'robot:8000'; it must be like http://HOST:PORT"),
        ("http://robot:many", "the address of the gateway, 'http://robot:many', is invalid: Port could not be"),
        ("http://[::1", r"the address of the gateway, 'http://\[::1', is invalid: Invalid IPv6 URL"),
        ("http://robot", "http://robot: --tls, --ca and --certificate need an address with https://"),
    ],
)
def test_wrong_addresses(address: str, sentence: str) -> None:
    with pytest.raises(GatewayRequestError, match=sentence):
        parse_address(address, Credentials(tls=True))


def test_a_file_that_is_no_certificate(tmp_path: Path) -> None:
    pem, key = certificate(tmp_path)
    for wrong in (Credentials(ca=key), Credentials(certificate=key, key=key)):
        with pytest.raises(OSError, match=r"SSL|PEM|X509") as caught:
            wrong.context()
        assert caught.value.filename == str(key)
    Credentials(ca=pem, certificate=pem, key=key).context()
    with pytest.raises(FileNotFoundError) as missing:
        Credentials(ca=tmp_path / "none.pem").context()
    assert missing.value.filename == str(tmp_path / "none.pem")


@contextmanager
def answering(data: bytes) -> Iterator[str]:
    """A server that sends data to one client, and closes the connection."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(10_000)
                connection.sendall(data)

        thread = Thread(target=serve)
        thread.start()
        yield f"127.0.0.1:{server.getsockname()[1]}"
        thread.join()


def test_reasons(tmp_path: Path) -> None:
    pem, _ = certificate(tmp_path)
    for data, scheme, reason in (
        (b"", "http", "the connection was closed"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\nhalf", "http", "the connection was closed"),
        (b"SSH-2.0-OpenSSH\r\n", "http", "it does not speak HTTP"),
        (b"HTTP/1.1 400 Bad\r\n\r\n", "https", "it does not speak TLS"),
    ):
        with answering(data) as address, pytest.raises(GatewayError) as caught:
            fetch(f"{scheme}://{address}", "scene.glb", Credentials(ca=pem if scheme == "https" else None), "scene")
        assert str(caught.value).startswith(f"{scheme}://{address} gives no scene: {reason}")
