"""A gateway process with TLS and tokens on every interface, and its log."""

import ssl
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import grpc
import httpx2
import pytest
from grpc_health.v1 import health_pb2, health_pb2_grpc

from scenegate.camera import image_interface_pb2 as pb
from tests.support import clients
from tests.support.certificates import certificate
from tests.support.command import Ran, scenegate
from tests.support.gateway_process import GatewayProcess, gateway_process
from tests.support.waiting import SECONDS

TOKEN, CAMERA = "http-token-0123456789", "grpc-token-0123456789"
BEARER = {"Authorization": f"Bearer {TOKEN}"}


@dataclass
class Secured:
    process: GatewayProcess
    url: str
    context: ssl.SSLContext
    pem: bytes
    grpc_port: int

    def http(self) -> httpx2.Client:
        return clients.Client(base_url=self.url, verify=self.context)


@pytest.fixture(scope="module")
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Secured]:
    folder = tmp_path_factory.mktemp("secured")
    pem, key = certificate(folder)
    (folder / "http").write_text(TOKEN)
    (folder / "grpc").write_text(CAMERA)
    flags: tuple[str, ...] = ("--lcm-url", "off", "--tcpq-port", "0", "--grpc-port", "0", "--rest-port", "0", "--demo")
    flags += ("--http-certificate", str(pem), "--http-key", str(key), "--http-token-file", str(folder / "http"))
    flags += ("--grpc-certificate", str(pem), "--grpc-key", str(key), "--grpc-token-file", str(folder / "grpc"))
    flags += ("--cors-origins", "https://page.example", "--log-level", "debug")
    with gateway_process(*flags) as (process, url):
        context = ssl.create_default_context(cafile=str(pem))
        health = clients.get(f"{url}/healthz", verify=context, headers=BEARER).json()["interfaces"]
        yield Secured(process, url, context, pem.read_bytes(), int(health["stereo"]["port"]))
        assert process.stop() == 0
        log = process.rest_of_log()
        assert not [entry for entry in log if entry["level"] in ("error", "critical", "raw")]
        assert not [entry for entry in log if TOKEN in str(entry) or CAMERA in str(entry)], "tokens are never logged"


def test_http_requires_the_token_over_tls(secured: Secured) -> None:
    assert secured.url.startswith("https://")
    with secured.http() as http:
        for path in ("/", "/view", "/scene", "/docs", "/openapi.json", "/metrics", "/api/v2/system", "/nothing"):
            assert http.get(path).status_code == 401, path
        assert http.post("/render", content=b"x" * 100_000).status_code == 401
        assert http.get("/readyz").status_code == 200
        for path in ("/", "/view", "/scene", "/docs", "/metrics", "/api/v2/system"):
            assert http.get(path, headers=BEARER).status_code == 200, path


def test_rest_port_requires_the_token(secured: Secured) -> None:
    with secured.http() as http:
        port = http.get("/healthz").json()["interfaces"]["rest"]["port"]
        url = f"https://127.0.0.1:{port}/api/v2/system"
        assert http.get(url).status_code == 401
        assert http.get(url, headers=BEARER).status_code == 200


def test_cors_allows_configured_origins_only(secured: Secured) -> None:
    with secured.http() as http:
        for origin, allowed in {"https://page.example": True, "https://evil.example": False}.items():
            asked = {"Origin": origin, "Access-Control-Request-Method": "POST"}
            answer = http.options("/render", headers={**asked, "Access-Control-Request-Headers": "authorization"})
            assert (answer.headers.get("access-control-allow-origin") == origin) is allowed
            answer = http.get("/scene", headers={**BEARER, "Origin": origin})
            assert ("access-control-allow-origin" in answer.headers) is allowed
            assert not allowed or "X-Scene-Revision" in answer.headers["access-control-expose-headers"]


def stream(secured: Secured, metadata: Any) -> Any:
    credentials = grpc.ssl_channel_credentials(secured.pem)
    options = [("grpc.max_receive_message_length", -1)]
    with grpc.secure_channel(f"127.0.0.1:{secured.grpc_port}", credentials, options) as channel:
        call = channel.unary_stream(
            "/ImageInterface/StreamImageSets",
            request_serializer=pb.ImageSetRequest.SerializeToString,
            response_deserializer=pb.ImageSet.FromString,
        )
        return next(call(pb.ImageSetRequest(left_enabled=True), metadata=metadata, timeout=SECONDS))


def test_image_stream_requires_its_own_token(secured: Secured) -> None:
    assert stream(secured, [("authorization", f"Bearer {CAMERA}")]).left.width > 0
    for metadata in (None, [("authorization", f"Bearer {TOKEN}")], [("authorization-bin", b"\xff")]):
        with pytest.raises(grpc.RpcError) as caught:
            stream(secured, metadata)
        assert caught.value.code() is grpc.StatusCode.UNAUTHENTICATED


def test_grpc_health_checks_need_no_token(secured: Secured) -> None:
    credentials = grpc.ssl_channel_credentials(secured.pem)
    with grpc.secure_channel(f"127.0.0.1:{secured.grpc_port}", credentials) as channel:
        answer = health_pb2_grpc.HealthStub(channel).Check(health_pb2.HealthCheckRequest(), timeout=SECONDS)
    assert answer.status == health_pb2.HealthCheckResponse.SERVING


def streamed(secured: Secured, folder: Path, *arguments: str, **environment: str) -> Ran:
    (folder / "ca.pem").write_bytes(secured.pem)
    command = ["stream", f"127.0.0.1:{secured.grpc_port}", "--left", "--count", "1", "--timeout", str(SECONDS)]
    with pytest.MonkeyPatch.context() as patch:
        for name, value in environment.items():
            patch.setenv(name, value)
        return scenegate(*command, *arguments)


def test_stream_command_with_authority_and_token(secured: Secured, tmp_path: Path) -> None:
    ca, token = tmp_path / "ca.pem", tmp_path / "token"
    token.write_text(f"# of the camera\n\n{CAMERA}\n")
    ways: list[tuple[list[str], dict[str, str]]] = [
        (["--ca", str(ca), "--token", CAMERA], {}),
        (["--ca", str(ca), "--token-file", str(token)], {"SCENEGATE_TOKEN": "not this one"}),
        ([], {"SCENEGATE_CA": str(ca), "SCENEGATE_TOKEN": CAMERA}),
    ]
    for arguments, environment in ways:
        result = streamed(secured, tmp_path, *arguments, **environment)
        assert result.exit_code == 0, result.stderr
        assert "1 sets" in result.stderr


@pytest.mark.parametrize("arguments", [[], ["--token", TOKEN]], ids=["none", "another"])
def test_stream_command_without_the_right_token(secured: Secured, tmp_path: Path, arguments: list[str]) -> None:
    result = streamed(secured, tmp_path, "--ca", str(tmp_path / "ca.pem"), *arguments)
    assert result.exit_code == 1
    assert "UNAUTHENTICATED: the metadata needs 'authorization: Bearer TOKEN'" in result.stderr
