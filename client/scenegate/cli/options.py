"""Types of options, and options that several commands have."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from scenegate.regular_files import standard_input

if TYPE_CHECKING:
    from scenegate.credentials import Credentials

Number = TypeVar("Number", int, float)


def existing_file(text: str) -> Path:
    """Return the path of an existing file or pipe; ``-`` is the standard input."""
    path = standard_input() if text == "-" else Path(text)
    if path.is_dir():
        raise argparse.ArgumentTypeError(f"{text!r} is a folder, not a file")
    if not path.exists():
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
            value = None
        if value is None or not value >= minimum or math.isinf(value):
            kind = "an integer" if isinstance(minimum, int) else "a number"
            raise argparse.ArgumentTypeError(f"{text!r} is not {kind} of {minimum:g} or more")
        return value

    return read


def add_lcm_url(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--lcm-url``."""
    help_text = "tcpq://HOST:PORT, udpm://...; default: LCM_DEFAULT_URL, or LCM's default"
    parser.add_argument("--lcm-url", metavar="URL", help=help_text)


def add_channels(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--channels``."""
    help_text = "only channels whose whole name matches (default: all)"
    parser.add_argument("--channels", metavar="PATTERN", default=".*", help=help_text)


def add_access(parser: argparse.ArgumentParser) -> None:
    """Add the options of the access to a gateway or camera: token and certificates."""
    access = parser.add_argument_group("access").add_argument
    help_text = "bearer token (also SCENEGATE_TOKEN). Other users of this machine can read command lines"
    access("--token", default=os.environ.get("SCENEGATE_TOKEN"), help=help_text)
    access("--token-file", type=existing_file, metavar="FILE", help="file with the token")
    access("--tls", action="store_true", help="encrypt, and trust the system's authorities")
    help_text = "encrypt, and trust this PEM authority (also SCENEGATE_CA)"
    access("--ca", type=existing_file, default=os.environ.get("SCENEGATE_CA"), metavar="FILE", help=help_text)
    access("--certificate", type=existing_file, metavar="FILE", help="PEM certificate of this client")
    access("--key", type=existing_file, metavar="FILE", help="PEM private key of --certificate")


def pop_credentials(values: dict[str, Any]) -> Credentials:
    """Remove the options of ``add_access`` from the values of all options, and return the credentials.

    Raises ValueError or OSError if a token is invalid or cannot be read, or a certificate has no key.
    """
    from scenegate.credentials import Credentials, read_token

    token, token_file = values.pop("token"), values.pop("token_file")
    if token_file is not None:
        token = read_token(token_file)
    return Credentials(token, *(values.pop(name) for name in ("tls", "ca", "certificate", "key")))
