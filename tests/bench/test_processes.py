"""Benches leave no process behind, whatever their peers start and however they end."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bench import running
from bench.treeviewer_clients import process
from tests.support.waiting import SECONDS, wait_until

ROOT = Path(__file__).parents[2]
SLEEPER = [sys.executable, "-c", "import time; time.sleep(3600)"]
START = f"""
import pathlib, subprocess, sys, time
null = subprocess.DEVNULL
sleeper = subprocess.Popen({SLEEPER!r}, stdout=null, stderr=null, start_new_session=True)
pathlib.Path(sys.argv[1]).write_text(str(sleeper.pid))
print("ready", flush=True)
"""
"""A program that starts another one in a session of its own, as meshcat does; its number is in the file of argv[1]."""
MESHCAT = f"""
import atexit, os, pathlib, subprocess

class Visualizer:
    def __init__(self):
        self.window = self
        null = subprocess.DEVNULL
        self.server_proc = subprocess.Popen({SLEEPER!r}, stdout=null, stderr=null, start_new_session=True)
        atexit.register(self.server_proc.kill)
        pathlib.Path(os.environ["PID_FILE"]).write_text(str(self.server_proc.pid))

    def __getitem__(self, name):
        return self

    def set_object(self, *_):
        pass

    def set_transform(self, *_):
        pass

    def url(self):
        return "http://127.0.0.1:7000/static/"
"""
"""meshcat, as far as the benches use it: its server is a process in a session of its own, killed by atexit alone."""
GEOMETRY = "def __getattr__(name): return lambda *arguments, **options: None"


def runs(pid: int) -> bool:
    """Return True if the process exists and is no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.fixture
def pid_file(tmp_path: Path) -> Path:
    """The file into which a started program's number is written."""
    return tmp_path / "pid"


@pytest.fixture
def meshcat(tmp_path: Path, pid_file: Path) -> dict[str, str]:
    """An environment in which ``import meshcat`` finds the stand-in."""
    package = tmp_path / "peers" / "meshcat"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(MESHCAT)
    (package / "geometry.py").write_text(GEOMETRY)
    path = os.pathsep.join((str(ROOT), str(package.parent)))
    return {**os.environ, "PYTHONPATH": path, "PID_FILE": str(pid_file)}


def test_what_a_part_of_a_bench_starts_ends_with_it(pid_file: Path) -> None:
    with process("-c", START + "time.sleep(3600)", str(pid_file)) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        started = int(pid_file.read_text())
        assert runs(started)
    wait_until(lambda: not runs(started))


@pytest.mark.parametrize("end", ["", "sys.exit(1)"], ids=["done", "failed"])
def test_what_a_bench_leaves_in_another_session_is_ended(pid_file: Path, end: str) -> None:
    ran = running.run(["-c", START + end, str(pid_file)], SECONDS)
    assert ran.output == "ready\n"
    assert bool(ran.failure) == bool(end)
    started = int(pid_file.read_text())
    wait_until(lambda: not runs(started))


def test_meshcats_server_ends_with_the_measurement(meshcat: dict[str, str], pid_file: Path) -> None:
    command = [sys.executable, "-m", "bench.treeviewer_peers", "0"]
    done = subprocess.run(command, cwd=ROOT, env=meshcat, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert '"name": "meshcat"' in done.stdout, done.stderr
    assert not runs(int(pid_file.read_text()))


TREE_VIEWER = ("-m", "bench.treeviewer_peers", "ask", "meshcat")
VIEWER = ("bench/viewer_servers.py", "meshcat")


@pytest.mark.parametrize(
    ("program", "how"),
    [
        (TREE_VIEWER, "SIGTERM"),
        (TREE_VIEWER, "SIGINT"),
        (TREE_VIEWER, "end of input"),
        (TREE_VIEWER, "no such job"),
        (VIEWER, "SIGTERM"),
        (VIEWER, "SIGINT"),
        (VIEWER, "end of input"),
    ],
)
def test_meshcats_server_ends_however_a_peer_ends(
    meshcat: dict[str, str], pid_file: Path, program: tuple[str, ...], how: str
) -> None:
    command = [sys.executable, *program]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, env=meshcat, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as peer:
        assert peer.stdout is not None
        assert peer.stdout.readline().startswith(("ready", "{"))
        if how.startswith("SIG"):
            peer.send_signal(signal.Signals[how])
        peer.communicate("no such job\n" if how == "no such job" else "", timeout=SECONDS)
    assert not runs(int(pid_file.read_text()))
