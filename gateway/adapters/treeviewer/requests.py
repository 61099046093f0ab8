"""A request as ``request_reader`` creates it and ``apply`` executes it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.treeviewer.config import Limits
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Path, Pose
from scenegate.messages.controls import AnyControl
from scenegate.messages.field_kinds import show

REQUEST: Final = "request"
"""Name of the warnings about a request itself, in place of a command's."""
Subject = tuple[str, Path | None]
"""Command and path that a warning is about; no path if it could not be read, or for commands of the page."""


class UnreadableRequestError(ValueError):
    """No command of a request is executed; the message is the reason."""


class Finding(msgspec.Struct, frozen=True, omit_defaults=True):
    """A warning about a command, or the reason why it cannot be executed: an element of ``Response.errors``."""

    command: str
    """``delete``, ``setgeometry``, ``settransform``, or a name of ``newer_commands``."""
    index: int
    """Index in the request's list of such commands; 0 if it is no list."""
    reason: str
    path: Path | None = None
    """None: the path could not be read, or the command has none."""

    @property
    def text(self) -> str:
        """Command, path and reason in one sentence."""
        if self.command == REQUEST:
            return self.reason
        path = "" if self.path is None else f" {show(list(self.path))}"
        return f"{self.command}[{self.index}]{path}: {self.reason}"


@dataclass(frozen=True, slots=True)
class ControlChange:
    """A command of ``setvalues``."""

    index: int
    """Index in the request's list of such commands."""
    path: Path
    """Path of the control."""
    value: Any
    """Value as received; unused if there are samples."""
    samples: NDArray[np.float64] | None
    """Samples to add to a plot, (N, 1 + curves); None: the command has a value."""


class Request(msgspec.Struct, gc=False):
    """Commands in the order of execution: deletes, geometries, transforms, properties."""

    deletes: list[Path] = []
    geometries: list[tuple[Path, tuple[Part, ...]]] = []
    transforms: list[tuple[Path, Pose]] = []
    properties: list[tuple[Path, bool | None, float | None]] = []
    """Path, visibility, opacity from 0 to 1; None: unchanged."""
    view: dict[str, Any] | None = None
    """Changed fields of the page's view, with values as in ``PageView``; None: no command."""
    click_paths: list[Path] | None = None
    """Paths whose clicks the client wants from now on; None: no command."""
    controls: list[AnyControl] | None = None
    """Controls that the client has in the page from now on; None: no command."""
    control_changes: list[ControlChange] = []
    newer_commands: list[str] = []
    """Names of the request's commands that Director does not have."""
    failures: list[Finding] = []
    """Commands that cannot be executed."""
    warnings: list[Finding] = []
    """Irregularities that were tolerated."""

    @property
    def commands(self) -> int:
        """Number of commands that edit the tree. Those in ``failures`` are not among them."""
        return len(self.deletes) + len(self.geometries) + len(self.transforms) + len(self.properties)

    def subjects(self) -> Iterator[Subject]:
        """Yield the subjects of all commands that could be read.

        The name without a path is the subject of the warnings about commands whose path could not be read.
        """
        yield REQUEST, None
        for name, paths in (
            ("delete", self.deletes),
            ("setgeometry", [path for path, _ in self.geometries]),
            ("settransform", [path for path, _ in self.transforms]),
            ("setproperty", [path for path, _, _ in self.properties]),
        ):
            yield from ((name, path) for path in paths)
            if paths:
                yield name, None
        if self.view is not None:
            yield "setview", None
        if self.click_paths is not None:
            yield "setclicks", None
        if self.controls is not None:
            yield "setcontrols", None
        if self.control_changes:
            yield "setvalues", None

    def fail(self, failure: Finding, limits: Limits) -> None:
        """Add a command that cannot be executed. Raises RequestError if more failed than the limit."""
        self.failures.append(failure)
        if len(self.failures) > limits.failed_commands:
            first = self.failures[0]
            raise UnreadableRequestError(
                f"more than {limits.failed_commands} commands cannot be executed, so nothing is done; {first.text}"
            )
