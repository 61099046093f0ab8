"""Runs the command ``scenegate`` in this process."""

import io
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass

from scenegate.cli import main


@dataclass(frozen=True)
class Ran:
    """A command that has ended."""

    exit_code: int
    stdout: str
    stderr: str


def scenegate(*arguments: str) -> Ran:
    """Run the command."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with redirect_stdout(out), redirect_stderr(err):
        try:
            main(arguments)
        except SystemExit as ended:
            if isinstance(ended.code, str):
                err.write(ended.code + "\n")
            code = 1 if isinstance(ended.code, str) else int(ended.code or 0)
    return Ran(code, out.getvalue(), err.getvalue())
