"""The command line: ``scenegate serve | render | stream | publish | record | play | dataset | check | warmup``."""

from __future__ import annotations

import sys

from gateway.cli import first_line


def main() -> None:
    """Run the command; the console script calls this."""
    first_line.write(sys.argv[1:])
    if sys.argv[1:] == ["doctor"]:  # before other imports: it says which of them fail
        from gateway.cli.doctor import print_findings

        sys.exit(0 if print_findings() else 1)
    try:
        from gateway.cli.commands import run  # after the line: where files are not in memory, it takes seconds
    except ImportError as error:
        sys.exit(f"scenegate: {error}; `scenegate doctor` says what is wrong with the installation")
    run()
