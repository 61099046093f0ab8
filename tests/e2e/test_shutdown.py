"""SIGTERM under load: accepted renders are answered, streams end with a status, the exit code is 0."""

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import grpc
import httpx2
import pytest

from scenegate.camera import image_interface_pb2 as pb
from tests.support import clients, forms
from tests.support.clients import figures
from tests.support.gateway_process import GatewayProcess, gateway_process
from tests.support.ports import free_ports
from tests.support.waiting import SECONDS

pytestmark = pytest.mark.slow

RENDERS = 12
TOO_MANY = 48
PIXELS = 4096
"""Width and height of an image: one thread needs longer for it than a client for its request."""


def post(url: str) -> httpx2.Response:
    fields = {**forms.drake_fields("color"), "width": str(PIXELS), "height": str(PIXELS)}
    content = forms.body(forms.gltf(), fields)
    with clients.Client() as http:
        return http.post(f"{url}/render", content=content, headers={"Content-Type": forms.CONTENT_TYPE})


def accepted(pool: ThreadPoolExecutor, url: str, count: int) -> list[Future[httpx2.Response]]:
    """Post images; return when the server has accepted all of them and some wait for a thread."""
    sent = [pool.submit(post, url) for _ in range(count)]
    while True:
        done = sum(one.done() for one in sent)
        assert done < count - 1, "they were over before the signal; ask for larger pictures"
        now = figures(url)  # of several processes: as old as their reports, also in what is done
        accepted = now["scenegate_render_running"] + now["scenegate_render_waiting"]
        if now['scenegate_calls_total{end="done"}'] + accepted >= count:
            return sent


def ends_well(process: GatewayProcess) -> None:
    assert process.stop() == 0
    assert not [entry for entry in process.rest_of_log() if entry["level"] in ("critical", "raw")]


@pytest.mark.parametrize("workers", ["1", "2"])
def test_accepted_renders_are_answered_and_new_connections_refused(workers: str) -> None:
    flags = ("--only", "render", "--workers", workers, "--threads", "1", "--shutdown-seconds", str(SECONDS))
    with ThreadPoolExecutor(RENDERS) as pool, gateway_process(*flags) as (process, url):
        sent = accepted(pool, url, RENDERS)
        ends_well(process)
        assert {one.result().status_code for one in sent} == {200}
        with pytest.raises(httpx2.ConnectError):
            clients.get(f"{url}/healthz")


@pytest.mark.parametrize("workers", ["1", "2"])
def test_renders_that_cannot_finish_in_time_get_503(workers: str) -> None:
    flags = ("--only", "render", "--workers", workers, "--threads", "1", "--shutdown-seconds", "1")
    with ThreadPoolExecutor(TOO_MANY) as pool, gateway_process(*flags) as (process, url):
        sent = accepted(pool, url, TOO_MANY)
        ends_well(process)
        answers = [one.result() for one in sent]
        rejected = [answer for answer in answers if answer.status_code == 503]
        assert rejected, "there was time for all of them; ask for larger pictures"
        assert all("shut" in answer.text and "retry-after" in answer.headers for answer in rejected)
        assert {answer.status_code for answer in answers} <= {200, 503}


def test_streams_end_with_unavailable_and_go_on_after_a_restart() -> None:
    (port,) = free_ports(1)
    flags = ("--only", "stereo", "--grpc-port", str(port))
    with grpc.insecure_channel(f"127.0.0.1:{port}", [("grpc.max_receive_message_length", -1)]) as channel:

        def stream() -> Any:
            return channel.unary_stream(
                "/ImageInterface/StreamImageSets", pb.ImageSetRequest.SerializeToString, pb.ImageSet.FromString
            )(pb.ImageSetRequest(left_enabled=True), timeout=SECONDS, wait_for_ready=True)

        newest = 0.0
        for _ in range(2):
            with gateway_process(*flags) as (process, url):
                sets = stream()
                first = next(sets)
                assert first.left.width == 1280
                assert first.timestamp.sec + first.timestamp.nsec * 1e-9 > newest
                assert figures(url)["scenegate_stereo_streams"] == 1.0
                with ThreadPoolExecutor(1) as pool:
                    ended = pool.submit(deque, sets, 0)  # a client that reads, to the end
                    ends_well(process)
                    error = ended.exception()
            assert isinstance(error, grpc.RpcError)
            assert error.code() is grpc.StatusCode.UNAVAILABLE
            assert "shutting down" in error.details()
            newest = first.timestamp.sec + first.timestamp.nsec * 1e-9
