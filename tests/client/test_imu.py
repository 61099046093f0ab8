"""IMU samples beside recorded image sets."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import numpy as np
import pytest
from fastapi import FastAPI

from gateway.adapters.stereo.routes.imu_routes import imu_router
from gateway.adapters.stereo.service import StereoService
from gateway.runtime.http.http_server import PortService
from scenegate.camera.imu import ImuRecorder
from scenegate.camera.stream import StreamOptions, receive_all
from scenegate.credentials import Credentials
from scenegate.gateway_http import GatewayError
from tests.adapters.stereo.conftest import Start, renderer, start
from tests.support.waiting import SECONDS, until

__all__ = ["renderer", "start"]


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for connections as long as every test does."""
    monkeypatch.setattr("scenegate.camera.stream.CONNECT_SECONDS", SECONDS)
    monkeypatch.setattr("scenegate.gateway_http.CONNECT_SECONDS", SECONDS)


@asynccontextmanager
async def served(service: StereoService) -> AsyncIterator[str]:
    app = FastAPI()
    app.include_router(imu_router(service))
    http = PortService(app, "127.0.0.1", 0)
    serving = asyncio.create_task(http.run())
    await until(lambda: http.ready)
    yield f"http://127.0.0.1:{http.status()['port']}"
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)


async def test_samples_are_written_beside_the_sets(start: Start, tmp_path: Path) -> None:
    camera = await start(rate="max", simulated_clock=True)
    async with served(camera.service) as url:
        options = StreamOptions(f"127.0.0.1:{camera.service.port}", left=True, count=40, output=tmp_path, imu=url)
        progress = await asyncio.to_thread(receive_all, options)
        assert progress.sets == 40
        lines = (tmp_path / "imu.csv").read_text().splitlines()
        assert lines[0].startswith("#timestamp [ns],w_RS_S_x [rad s^-1],")
        table = np.loadtxt(lines, delimiter=",", comments="#")
        assert (np.diff(table[:, 0]) == 5e6).all()
        assert table[0, 0] > 1.0e9
        assert table[-1, 0] > float(progress.timestamp) * 1e9 - 0.4e9
        assert np.linalg.norm(table[:, 4:].mean(axis=0)) == pytest.approx(9.81, abs=0.15)
        assert f"{progress.imu_samples} IMU samples" in progress.line()
        assert progress.imu_lost == 0
        await until(lambda: len(camera.service.imu.hub) == 0)
        with pytest.raises(GatewayError, match="404: there is no pipeline 3"):
            await asyncio.to_thread(receive_all, replace(options, pipeline=3))
    with pytest.raises(GatewayError, match="gives no IMU samples"):
        await asyncio.to_thread(receive_all, options)
    with pytest.raises(GatewayError, match="must be like http"):
        await asyncio.to_thread(receive_all, replace(options, imu="camera:8000"))
    with pytest.raises(GatewayError, match="is invalid: Port could not be"):
        await asyncio.to_thread(receive_all, replace(options, imu="http://camera:many"))


LINES = (
    b'{"timestamp":{"sec":1,"nsec":5},"linear_acceleration":{"x":1,"y":2,"z":3},"angular_velocity":{"x":4,"y":5,"z":6}}\n'
    b'{"lost":7}\n'
    b'{"timestamp":{"sec":1,"nsec":6},"linear_acceler'
)


class _CutStream(BaseHTTPRequestHandler):
    """Responds with ``LINES`` and disconnects; the token is required."""

    def do_GET(self) -> None:
        self.send_response(200 if self.headers["authorization"] == "Bearer secret" else 401)
        self.end_headers()
        self.wfile.write(LINES)

    def log_message(self, *_: object) -> None:
        pass


def test_streams_that_end_early(tmp_path: Path) -> None:
    with HTTPServer(("127.0.0.1", 0), _CutStream) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        url = f"http://127.0.0.1:{server.server_address[1]}"
        path = tmp_path / "imu.csv"
        with pytest.raises(GatewayError, match="401: "):
            ImuRecorder(url, path, Credentials())
        with ImuRecorder(url, path, Credentials("secret")) as recorder:
            assert recorder.wait_for_sample(1_000_000_005, SECONDS)
            assert not recorder.wait_for_sample(1_000_000_006, SECONDS), "the stream has ended"
            assert (recorder.samples, recorder.lost) == (1, 7)
            with pytest.raises(GatewayError, match="ended the IMU stream"):
                recorder.check()
        assert path.read_text().splitlines()[1:] == ["1000000005,4,5,6,1,2,3"]
        server.shutdown()
        thread.join()
