"""Standard streams of the command, as shells and service managers start it."""

import os
import subprocess
import sys

import pytest

COMMAND = f"{sys.executable} -m scenegate"


def run(arguments: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """Run the command in a shell."""
    shell = ["/bin/sh", "-c", f"{COMMAND} {arguments}"]
    return subprocess.run(shell, env={**os.environ, **environment}, capture_output=True)


PRINTING = """
from scenegate.cli import main, play
play.run = lambda options: print("a line", flush=True)
main(["play", __import__("os").devnull])
"""
"""A command that writes a line."""


@pytest.mark.parametrize(
    "program", [("-c", PRINTING), ("-m", "scenegate", "--help"), ("-m", "scenegate", "serve", "--help")]
)
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_the_end_of_the_reader_of_stdout_is_silent(program: tuple[str, ...], unbuffered: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    try:
        ran = subprocess.run([sys.executable, *program], stdout=writer, stderr=subprocess.PIPE, env=environment)
    finally:
        os.close(writer)
    assert ran.returncode in (0, 1)
    assert ran.stderr == b""


@pytest.mark.parametrize("encoding", ["ascii", "ascii:surrogateescape"])
def test_characters_that_stdout_cannot_encode_are_replaced(encoding: str) -> None:
    ran = run("serve --help-all", PYTHONIOENCODING=encoding)
    assert (ran.returncode, ran.stderr) == (0, b"")
    assert b"--http-port" in ran.stdout
    assert b"?" in ran.stdout


@pytest.mark.parametrize(("command", "code"), [("play --help", 0), ("doctor --help", 0), ("serve --http-port many", 2)])
def test_closed_streams_are_replaced(command: str, code: int) -> None:
    ran = run(f"{command} 0<&- 1>&- 2>&-")
    assert (ran.returncode, ran.stdout, ran.stderr) == (code, b"", b"")
