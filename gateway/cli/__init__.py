"""The server's commands: ``scenegate serve | view | render | export | dataset | convert | doctor | warmup``."""

import gc
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import NoReturn

from gateway.cli import first_line
from scenegate.cli.output import exit_with_usage_error


def _stop(arguments: Sequence[str]) -> NoReturn:
    with suppress(OSError):  # the reader of stderr may have ended
        first_line.write(arguments, first_line.STOPPED)
    sys.exit(0)


def main(arguments: Sequence[str]) -> None:
    """Run a command with its arguments; the entry points of ``scenegate.commands`` call this. Raises SystemExit."""
    if list(arguments[:1]) == ["serve"]:
        signal.signal(signal.SIGTERM, lambda *_: _stop(arguments))  # until the server handles it
    first_line.write(arguments)
    if list(arguments) == ["doctor"]:  # before other imports: it says which of them fail
        from gateway.cli.doctor import print_findings

        sys.exit(0 if print_findings() else 1)
    name = "scenegate"
    if list(arguments[:1]) == ["render"]:  # without the imports of the other commands, a twentieth of its time
        from gateway.cli.render import app

        name, arguments = "scenegate render", arguments[1:]
    else:
        from gateway.cli.commands import app  # after the line: where files are not in memory, it takes seconds

    try:
        sys.exit(app(arguments, prog_name=name, standalone_mode=False))
    except Exception as error:
        if not hasattr(error, "format_message"):  # Typer exports none of its errors' base classes
            raise
        context = getattr(error, "ctx", None)
        exit_with_usage_error(context.command_path if context else name, error.format_message())
    finally:
        gc.freeze()  # or the interpreter, when it ends, searches half a million objects for garbage, for 0.3 s
