"""Standard streams of a command: closed ones, characters that stdout cannot encode, and readers that have ended."""

import io
import os
import select
import sys


def prepare() -> None:
    """Open the null device in place of closed streams, and write ``?`` for characters that stdout cannot encode.

    Without the former, the first sockets of the process would be its standard streams.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            # The lowest free descriptor is that of the closed stream; it stays open until the process ends.
            stream = open(os.open(os.devnull, os.O_RDWR), mode, encoding="utf-8", errors="replace")  # noqa: PTH123, SIM115
            setattr(sys, name, stream)
    out = sys.stdout
    if isinstance(out, io.TextIOWrapper) and (out.errors == "strict" or out.encoding.lower() not in ("utf-8", "utf8")):
        out.reconfigure(errors="replace")


def flush() -> None:
    """Write what stdout holds back, or discard it if its reader has ended: at exit, that would be an error."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        reader_has_ended()


def reader_has_ended() -> bool:
    """Return whether stdout is a pipe without a reader. Output that waits is then discarded at exit."""
    try:
        descriptor = sys.stdout.fileno()
        poll = select.poll()
    except (OSError, AttributeError):  # not a file; Windows, which reports another error for pipes
        return False
    poll.register(descriptor, select.POLLOUT)
    has_ended = any(events & (select.POLLERR | select.POLLHUP) for _, events in poll.poll(0))  # HUP: macOS
    if has_ended:
        os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)
    return has_ended
