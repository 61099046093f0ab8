"""Credentials of a client: token, certificate, trust."""

import asyncio
from pathlib import Path

import grpc
import pytest

from scenegate.credentials import Credentials, read_token
from tests.support.certificates import certificate
from tests.support.waiting import SECONDS


def test_no_metadata_by_default() -> None:
    assert Credentials().metadata == ()
    assert Credentials(token=" a-token-0123456789 ").metadata == (("authorization", "Bearer a-token-0123456789"),)


@pytest.mark.parametrize("token", ["", "  ", "two\nlines", "schl\u00fcssel"])
def test_rejects_tokens_with_invalid_characters(token: str) -> None:
    with pytest.raises(ValueError, match="printable ASCII"):
        Credentials(token=token)


def test_a_certificate_needs_its_key(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="need each other"):
        Credentials(certificate=tmp_path / "client.pem")


def test_reads_the_first_token_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "tokens"
    path.write_text("# old ones below\n\n  first-0123456789  \nsecond-0123456789\n")
    assert read_token(path) == "first-0123456789"
    path.write_text("# none\n")
    with pytest.raises(ValueError, match="has no token"):
        read_token(path)


async def test_a_proxy_of_the_environment_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    server = grpc.aio.server()
    port = server.add_insecure_port("127.0.0.1:0")
    await server.start()
    for name in ("grpc_proxy", "http_proxy", "https_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:1")
    for name in ("no_grpc_proxy", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
    try:
        with Credentials().channel(f"127.0.0.1:{port}") as channel:
            call = channel.unary_unary("/Unknown/Method")
            with pytest.raises(grpc.RpcError) as caught:
                await asyncio.to_thread(call, b"", timeout=SECONDS)
            assert caught.value.code() is grpc.StatusCode.UNIMPLEMENTED, caught.value
    finally:
        await server.stop(None)


async def test_client_certificate(tmp_path: Path) -> None:
    pem, key = certificate(tmp_path)
    own, own_key = certificate(tmp_path, "client")
    server = grpc.aio.server()
    wanted = grpc.ssl_server_credentials([(key.read_bytes(), pem.read_bytes())], own.read_bytes(), True)
    port = server.add_secure_port("127.0.0.1:0", wanted)
    await server.start()
    try:
        for credentials, comes_in in (
            (Credentials(ca=pem, certificate=own, key=own_key), True),
            (Credentials(ca=pem), False),
        ):
            with credentials.channel(f"127.0.0.1:{port}") as channel:
                call = channel.unary_unary("/Unknown/Method")
                with pytest.raises(grpc.RpcError) as caught:
                    await asyncio.to_thread(call, b"", timeout=SECONDS, metadata=credentials.metadata)
                is_there = caught.value.code() is grpc.StatusCode.UNIMPLEMENTED
                assert is_there is comes_in, caught.value
    finally:
        await server.stop(None)
