"""Lines of ``scenegate serve`` that are written before its log is configured: the first one, and the last one of a
server that is stopped so early.

On a slow disk and a busy machine, imports take ten seconds. This module imports only small modules of the standard
library, so it parses two settings itself, the log's level and format; ``gateway.runtime.settings`` checks them later.
"""

import json
import os
import sys
import time
from collections.abc import Sequence
from typing import Any, Final

from gateway import __version__

BEGIN: Final = time.perf_counter()
"""Time of the start of the command."""


START: Final = f"Scenegate {__version__} starts: loading its libraries"
STOPPED: Final = "Scenegate has stopped"


def write(arguments: Sequence[str], event: str = START) -> None:
    """Write a line to stderr in the format of the log, if the arguments start a server that logs at this level."""
    if list(arguments[:1]) != ["serve"] or any(each.startswith("--help") for each in arguments):
        return
    if _setting("log_level", arguments) not in (None, "debug", "info"):
        return
    log_format = _setting("log_format", arguments)
    if log_format == "human" or (log_format != "json" and sys.stderr.isatty()):
        line = f"{time.strftime('%H:%M:%S')} [info     ] {event}{' ...' if event == START else ''}"
    else:
        now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        line = json.dumps({"event": event, "level": "info", "logger": "gateway", "timestamp": now})
    if event == STOPPED:  # a handler of signals writes it, which may not use a stream that is in use
        os.write(sys.stderr.fileno(), f"{line}\n".encode())
    else:
        print(line, file=sys.stderr, flush=True)  # noqa: T201 - the log is not configured yet


def _setting(name: str, arguments: Sequence[str]) -> Any:
    """Return a setting from the flags, the environment or the TOML file; None if none of them has it."""
    from_environment = os.environ.get(f"SCENEGATE_{name.upper()}")
    return _flag(f"--{name.replace('_', '-')}", arguments) or from_environment or _from_file(name, arguments)


def _flag(flag: str, arguments: Sequence[str]) -> str | None:
    for argument, following in zip(arguments, (*arguments[1:], None), strict=True):
        if argument == flag:
            return following
        if argument.startswith(f"{flag}="):
            return argument.partition("=")[2]
    return None


def _from_file(name: str, arguments: Sequence[str]) -> Any:
    path = _flag("--config", arguments) or os.environ.get("SCENEGATE_CONFIG")
    if not path:
        return None
    import tomllib

    from scenegate.regular_files import read_text

    try:
        values = tomllib.loads(read_text(path))
    except (OSError, ValueError):  # reported when the settings are loaded
        return None
    return values.get(name, values.get(name.replace("_", "-")))
