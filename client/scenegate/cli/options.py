"""Types of options, and options that several commands have."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

Number = TypeVar("Number", int, float)


def existing_file(text: str) -> Path:
    """Return the path of an existing file or pipe."""
    path = Path(text)
    if not path.exists() or path.is_dir():
        raise argparse.ArgumentTypeError(f"there is no file {text!r}")
    return path


def existing_folder(text: str) -> Path:
    """Return the path of an existing folder."""
    path = Path(text)
    if not path.is_dir():
        raise argparse.ArgumentTypeError(f"there is no folder {text!r}")
    return path


def at_least(minimum: Number) -> Callable[[str], Number]:
    """Return the function that reads a number of a minimum, of the minimum's type."""

    def read(text: str) -> Number:
        try:
            value = type(minimum)(text)
        except ValueError:
            value = type(minimum)(minimum - 1)
        if not value >= minimum or math.isinf(value):
            kind = "an integer" if isinstance(minimum, int) else "a number"
            raise argparse.ArgumentTypeError(f"{text!r} is not {kind} of {minimum:g} or more")
        return value

    return read


def add_lcm_url(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--lcm-url``."""
    text = "tcpq://HOST:PORT, udpm://...; default: LCM_DEFAULT_URL, or LCM's default"
    parser.add_argument("--lcm-url", metavar="URL", help=text)


def add_channels(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--channels``."""
    text = "only channels whose whole name matches (default: all)"
    parser.add_argument("--channels", metavar="PATTERN", default=".*", help=text)
