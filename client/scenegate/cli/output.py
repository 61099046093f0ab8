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


def exit_with_usage_error(command: str, message: str) -> NoReturn:
    """Write why a command cannot be run as it was typed, and exit with 2."""
    sentence = message.replace("Value error, ", "").rstrip(".?")  # pydantic's prefix of our own sentences
    print_note(f"{command}: {sentence[:1].lower()}{sentence[1:]}; `{command} --help` explains it")
    sys.exit(2)


class ArgumentParser(argparse.ArgumentParser):
    """Parser whose errors are those of all commands."""

    def error(self, message: str) -> NoReturn:
        """Print the error, and exit with 2."""
        exit_with_usage_error(self.prog, message)
