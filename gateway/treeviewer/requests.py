"""A request as ``request_reader`` creates it and ``apply`` executes it."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from gateway.scene.geometry import Part
from gateway.scene.tree import Path, Pose
from gateway.treeviewer.config import Limits


class RequestError(ValueError):
    """No command of a request is executed; the message is the reason."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A command that cannot be executed."""

    command: str
    """``delete``, ``setgeometry`` or ``settransform``."""
    index: int
    """Index in the request's list of such commands."""
    path: Path | None
    """None: the path could not be read."""
    reason: str


class Request(msgspec.Struct, gc=False):
    """Commands in the order of execution: all deletes, then all geometries, then all transforms."""

    deletes: list[Path] = []
    geometries: list[tuple[Path, tuple[Part, ...]]] = []
    transforms: list[tuple[Path, Pose]] = []
    failures: list[Failure] = []
    warnings: list[str] = []
    """One sentence for each irregularity that was tolerated."""

    @property
    def commands(self) -> int:
        """Number of commands to execute, without ``failures``."""
        return len(self.deletes) + len(self.geometries) + len(self.transforms)

    def fail(self, failure: Failure, limits: Limits) -> None:
        """Add a command that cannot be executed.

        Raises:
            RequestError: more commands failed than the limit.
        """
        self.failures.append(failure)
        if len(self.failures) > limits.failed_commands:
            first = self.failures[0]
            raise RequestError(
                f"more than {limits.failed_commands} commands cannot be carried out, so nothing is done; "
                f"{first.command}[{first.index}]: {first.reason}"
            )
