"""Errors of commands: one sentence on stderr and exit code 1."""

from __future__ import annotations

import errno
from typing import NoReturn

import pytest

from gateway.cli import commands, main


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (ValueError("--samples 2 is not one of 0, 1, 4, 8"), "--samples 2 is not one of 0, 1, 4, 8"),
        (RuntimeError("no kernels"), "no kernels"),
        (ImportError("no lcm"), "no lcm"),
        (OSError("out.png: it took longer than 3 s"), "out.png: it took longer than 3 s"),
        (OSError(errno.ENOENT, "No such file or directory", "scene.glb"), "scene.glb: No such file or directory"),
    ],
)
def test_expected_errors_are_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: Exception, text: str
) -> None:
    def fail() -> NoReturn:
        raise error

    monkeypatch.setattr(commands, "app", fail)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert capsys.readouterr().err == f"scenegate: {text}\n"


def test_other_errors_keep_their_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> NoReturn:
        raise KeyError("a fault")

    monkeypatch.setattr(commands, "app", fail)
    with pytest.raises(KeyError):
        main()
