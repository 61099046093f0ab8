"""Errors of commands: one sentence on stderr and exit code 1."""

import errno
import subprocess
import sys
from importlib.metadata import entry_points
from typing import NoReturn

import pytest

from scenegate import cli
from scenegate.cli import play
from tests.support.command import Ran, scenegate


def play_that_raises(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> Ran:
    def fail(options: object) -> NoReturn:
        raise error

    monkeypatch.setattr(play, "run", fail)
    return scenegate("play", __file__)


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (ValueError("--samples 2 is not one of 0, 1, 4, 8"), "--samples 2 is not one of 0, 1, 4, 8"),
        (RuntimeError("no kernels"), "no kernels"),
        (ImportError("no lcm"), "no lcm"),
        (OSError("out.png: it took longer than 3 s"), "out.png: it took longer than 3 s"),
        (OSError(errno.ENOENT, "No such file or directory", "scene.glb"), "scene.glb: No such file or directory"),
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), "Broken pipe"),
    ],
)
def test_expected_errors_are_one_sentence(monkeypatch: pytest.MonkeyPatch, error: Exception, text: str) -> None:
    assert play_that_raises(monkeypatch, error) == Ran(1, "", f"scenegate: {text}\n")


def test_an_interrupt_is_silent_and_other_errors_keep_their_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    assert play_that_raises(monkeypatch, KeyboardInterrupt()) == Ran(130, "", "")
    with pytest.raises(KeyError):
        play_that_raises(monkeypatch, KeyError("a fault"))


HANGUP = """
import os
import signal
import sys
from scenegate.cli import main, play
signal.signal(signal.SIGHUP, getattr(signal, sys.argv[1]))
signal.signal(signal.SIGTERM, lambda *_: print("SIGTERM"))
play.run = lambda options: signal.raise_signal(signal.SIGHUP)
main(["play", os.devnull])
"""


@pytest.mark.parametrize(("handler", "output"), [("SIG_DFL", "SIGTERM\n"), ("SIG_IGN", "")])
def test_a_terminal_that_closes_ends_a_command_as_sigterm_does_except_under_nohup(handler: str, output: str) -> None:
    ran = subprocess.run([sys.executable, "-c", HANGUP, handler], capture_output=True, text=True)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, output, "")


IN_A_THREAD = """
import os
from threading import Thread
from scenegate.cli import main, play
play.run = lambda options: print("ran")
thread = Thread(target=main, args=(["play", os.devnull],))
thread.start()
thread.join()
"""


def test_commands_run_in_any_thread() -> None:
    ran = subprocess.run([sys.executable, "-c", IN_A_THREAD], capture_output=True, text=True)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "ran\n", "")


def test_help_lists_the_commands_of_both_distributions() -> None:
    shown = scenegate("--help")
    assert shown.exit_code == 0
    for name in (*cli.CLIENT_COMMANDS, *cli.SERVER_COMMANDS):
        assert f"\n    {name} " in shown.stdout
    assert (scenegate().exit_code, scenegate().stdout) == (0, shown.stdout)


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["strem"], "there is no command 'strem'; did you mean stream"),
        (["--verison"], "there is no command '--verison'; did you mean --version"),
        (["play", __file__, "--duratoin", "3"], "unrecognized arguments: --duratoin 3; did you mean --duration"),
        (["serve", "--http-prot", "0"], "--http-port"),
    ],
)
def test_a_misspelt_name_gets_a_suggestion(arguments: list[str], hint: str) -> None:
    ran = scenegate(*arguments)
    assert ran.exit_code == 2
    assert hint in ran.stderr


def test_commands_of_the_server_have_entry_points() -> None:
    assert {each.name for each in entry_points(group="scenegate.commands")} == set(cli.SERVER_COMMANDS)


@pytest.mark.parametrize("command", cli.SERVER_COMMANDS)
def test_without_the_server_the_remedy_is_named(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli, "entry_points", lambda **_: [])
    ran = scenegate(command, "--help")
    remedy = f"`scenegate {command}` needs the server, which is not installed: pip install scenegate"
    assert (ran.exit_code, ran.stderr) == (1, f"scenegate: {remedy}\n")
