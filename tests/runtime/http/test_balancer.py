"""Render replicas behind HAProxy with our configuration (deploy/haproxy)."""

import csv
import io
import os
import re
import shutil
import signal
import subprocess
import threading
import urllib.request
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest

from bench.gateways import Answer, gateway, post
from bench.render_requests import textured
from tests.support.waiting import wait_until

CONFIG = Path(__file__).parents[3] / "deploy" / "haproxy" / "haproxy.cfg"
FLAGS = ("--only", "render", "--threads", "1", "--queue", "16")
CLIENTS = 8


@contextmanager
def haproxy(folder: Path, ports: Sequence[int]) -> Iterator[int]:
    """HAProxy in front of replicas on these ports, which it has found ready; yields its port."""
    front, stats = 20000 + os.getpid() % 20000, 20001 + os.getpid() % 20000
    text = CONFIG.read_text().replace("bind :8080", f"bind 127.0.0.1:{front}")
    text = text.replace("bind :8405", f"bind 127.0.0.1:{stats}")
    servers = "\n".join(f"    server replica{n} 127.0.0.1:{port}" for n, port in enumerate(ports))
    file = folder / "haproxy.cfg"
    file.write_text(re.sub(r"^ +server-template .*$", servers, text, flags=re.MULTILINE))

    def all_up() -> bool:
        assert process.poll() is None, f"haproxy ended with {process.returncode}"
        with suppress(OSError), urllib.request.urlopen(f"http://127.0.0.1:{stats}/;csv") as answer:
            rows = csv.DictReader(io.StringIO(answer.read().decode().removeprefix("# ")))
            replicas = [row for row in rows if row["pxname"] == "replicas" and row["svname"].startswith("replica")]
            return all(row["status"].startswith("UP") for row in replicas)
        return False

    with subprocess.Popen(["haproxy", "-q", "-db", "-f", file], stdout=subprocess.DEVNULL) as process:
        try:
            wait_until(all_up)
            yield front
        finally:
            process.terminate()


def test_haproxy_reads_its_configuration() -> None:
    if shutil.which("haproxy") is None:
        pytest.skip("there is no haproxy")
    subprocess.run(["haproxy", "-c", "-f", CONFIG], check=True)


@pytest.mark.slow
def test_ended_replicas_are_hidden_by_the_balancer(tmp_path: Path) -> None:
    """One of three replicas is killed after a third of the requests, another one told to end after two thirds."""
    if shutil.which("haproxy") is None:
        pytest.skip("there is no haproxy")
    scene = textured("label", copies=1, unique=1, side=64)
    bodies = [scene.next_body(160, 120) for _ in range(60)]
    answered: list[Answer] = []
    strikes = {20: threading.Event(), 40: threading.Event()}

    with ExitStack() as stack:
        replicas = [stack.enter_context(gateway(*FLAGS)) for _ in range(3)]
        expected = [post(replicas[0].port, body).body for body in bodies]
        port = stack.enter_context(haproxy(tmp_path, [replica.port for replica in replicas]))

        def render(body: bytes) -> Answer:
            answer = post(port, body)
            answered.append(answer)
            if (event := strikes.get(len(answered))) is not None:
                event.set()
            return answer

        def strike() -> None:
            for event, replica, number in zip(
                strikes.values(), replicas[1:], (signal.SIGKILL, signal.SIGTERM), strict=True
            ):
                event.wait()
                replica.process.send_signal(number)

        with ThreadPoolExecutor(CLIENTS + 1) as pool:
            striking = pool.submit(strike)
            answers = list(pool.map(render, bodies))
            striking.result()
    assert [answer.status for answer in answers] == [200] * len(bodies)
    assert [answer.body for answer in answers] == expected
