"""Checks of ``scenegate doctor`` that need only the standard library, so that they work where others do not."""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from importlib.metadata import PackageNotFoundError, version
from typing import Final

import gateway

_PIP_SECONDS: Final = 60.0
"""Timeout of ``pip check``, which takes a second."""
_NOT_STARTED: Final = "Scenegate does not start, or some of its interfaces fail."


class Verdict(Enum):
    OK = "ok"
    NOTE = "note"
    """Works with restrictions."""
    ERROR = "error"
    """Scenegate, or one of its interfaces, does not work."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One row of the table."""

    subject: str
    verdict: Verdict
    detail: str
    """Sentence that states the finding."""
    meaning: str = ""
    """Sentence that states its effect; empty if all is well."""
    remedy: str = ""
    """Remedy, such as a command."""


def installation_findings() -> Iterator[Finding]:
    """Check the libraries with ``pip check``: what it says of our distributions."""
    yield Finding("scenegate", Verdict.OK, gateway.__version__)
    try:
        version("pip")
    except PackageNotFoundError:
        meaning = "The versions of the libraries are not compared with what Scenegate requires."
        yield Finding("libraries", Verdict.NOTE, "there is no pip", meaning, "uv pip check, or python -m ensurepip")
        return
    command = (sys.executable, "-m", "pip", "--disable-pip-version-check", "check")
    try:
        checked = subprocess.run(  # noqa: S603 - this interpreter, constant arguments
            command, capture_output=True, text=True, timeout=_PIP_SECONDS, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        yield Finding("libraries", Verdict.NOTE, f"pip check: {error}", "The libraries are not checked.", "pip check")
        return
    conflicts = [line for line in checked.stdout.splitlines() if line.startswith(("scenegate ", "scenegate-client "))]
    for conflict in conflicts:
        remedy = "pip install --upgrade --force-reinstall scenegate"
        yield Finding("libraries", Verdict.ERROR, conflict.rstrip("."), _NOT_STARTED, remedy)
    if not conflicts:
        yield Finding("libraries", Verdict.OK, "as Scenegate requires them (pip check)")
