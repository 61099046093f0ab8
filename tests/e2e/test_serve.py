"""``scenegate serve`` as a process: start, first requests, signals, errors at start."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import httpx2
import pytest

import gateway.app
from gateway.runtime.settings import SettingsError
from tests.conftest import DemoGateway
from tests.support import clients
from tests.support.gateway_process import gateway_process
from tests.support.ports import free_ports
from tests.support.waiting import SECONDS


def test_docs_work_offline(demo_gateway: DemoGateway) -> None:
    url = demo_gateway.url
    docs = clients.get(f"{url}/docs")
    assert docs.status_code == 200
    assert not re.search(r"""(?:src|href)=["'](?:https?:)?//""", docs.text)
    for link in re.findall(r"""(?:src|href)=["'](/[^"']+)""", docs.text):
        assert clients.get(url + link).status_code == 200
    assert {"/render", "/healthz"} <= clients.get(f"{url}/openapi.json").json()["paths"].keys()


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)])
def test_a_render_only_gateway_from_its_start_to_a_signal(number: signal.Signals) -> None:
    """It links only to its own pages, and ends with exit code 0."""
    with gateway_process("--only", "render") as (process, url):
        assert clients.get(f"{url}/readyz").status_code == 200
        listens, started = (process.log[index] for index in (1, -1))
        assert listens["event"] == "Scenegate listens; look at / and /docs"
        assert started["url"] == f"{url}/"
        links = re.findall(r'<a href="([^"]+)"', clients.get(url).text)
        assert links
        assert all(clients.get(f"{url}/{link}").status_code == 200 for link in links)
        process.process.send_signal(number)
        assert process.process.wait(SECONDS) == 0
        log = process.rest_of_log()
        assert not [entry for entry in log if entry["level"] in ("error", "critical", "raw")]
        assert [entry["event"] for entry in log][-2:] == [
            "Scenegate stops; requests that it has accepted may finish",
            "Scenegate has stopped",
        ]


def test_uvicorn_refuses_our_number_of_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCENEGATE_WORKERS", "2")
    monkeypatch.setenv("SCENEGATE_ONLY", "render")
    with pytest.raises(SettingsError, match=r"SCENEGATE_WORKERS .*scenegate serve"):
        _ = gateway.app.app


def test_too_little_address_space_is_one_sentence() -> None:
    command = f"ulimit -v 800000; exec {sys.executable} -m scenegate serve --http-port 0 --lcm-url off"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=SECONDS, check=False)
    assert done.returncode == 1, done.stderr
    assert "781 MB" in done.stderr.splitlines()[-1]


@pytest.mark.slow
def test_uvicorn_serves_the_same_application_and_logs_json(tmp_path: Path) -> None:
    (port,) = free_ports(1)
    command = [sys.executable, "-m", "uvicorn", "gateway.app:app", "--port", str(port)]
    environment = {**os.environ, "SCENEGATE_ONLY": "render", "SCENEGATE_LOG_FORMAT": "json"}
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, bufsize=1
    )
    lines: list[str] = []
    try:
        assert process.stdout is not None
        for line in process.stdout:
            lines.append(line)
            if "Scenegate has started" in line:
                break
        transport = httpx2.HTTPTransport(retries=20)
        with clients.Client(transport=transport, base_url=f"http://127.0.0.1:{port}") as client:
            assert client.get("/readyz").json()["status"] == "ready"
            assert client.get("/nothing", headers={"X-Request-ID": "r1"}).status_code == 404
    finally:
        process.terminate()
        lines += process.communicate(timeout=SECONDS)[0].splitlines()
    log = [json.loads(line) for line in lines]
    assert [entry["request_id"] for entry in log if entry.get("path") == "/nothing"] == ["r1"]
    assert any(f"http://127.0.0.1:{port}" in entry["event"] for entry in log)
    assert any(entry["event"].startswith("Finished server process") for entry in log)
