"""Lines that commands print. All text from outside passes here, see ``scenegate.printable``."""

import argparse
import sys
from typing import NoReturn

from scenegate.printable import printable


def print_line(text: str) -> None:
    """Write one line to stdout."""
    print(printable(text), flush=True)


def print_note(text: str) -> None:
    """Write one line to stderr: a note, a warning or an error."""
    print(printable(text), file=sys.stderr, flush=True)


class ArgumentParser(argparse.ArgumentParser):
    """Parser that names invalid arguments without their control characters."""

    def error(self, message: str) -> NoReturn:
        """Print usage and error, and exit with 2."""
        super().error(printable(message))
