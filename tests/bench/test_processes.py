"""Benches leave no process behind, whatever their peers start and however they end."""

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
