"""States of the interfaces: the source of ``/healthz``, ``/readyz`` and the log line at start."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol

from gateway.runtime.logs.warning_list import WarningList
from scenegate.printable import encodable


class Service(Protocol):
    """A long-running interface."""

    async def run(self) -> None:
        """Serve until cancelled, then clean up; raise if the interface cannot work."""

    @property
    def ready(self) -> bool:
        """True while clients can use it."""

    def status(self) -> Mapping[str, Any]:
        """Return figures for ``/healthz``, plain JSON values; ``warnings`` is a list of sentences."""


class InterfaceState(StrEnum):
    STARTING = "starting"
    READY = "ready"
    FAILED = "failed"
    STOPPED = "stopped"


@dataclass(slots=True)
class Entry:
    """State of one interface, or of the kernels."""

    state: InterfaceState = InterfaceState.STARTING
    problem: str = ""
    """Reason of a failure, one sentence."""
    service: Service | None = None
    figures: Callable[[], Mapping[str, Any]] | None = None
    """Returns plain JSON values for ``/healthz`` while ready."""
    where: str = ""
    """Address for people, such as a path or URL."""
    progress: Callable[[], Mapping[str, Any]] | None = None
    """Returns plain JSON values for ``/healthz`` while starting."""
    warnings: WarningList = field(default_factory=WarningList)
    """Warnings about files that settings name. ``figures`` may have more."""

    def current(self) -> InterfaceState:
        """Return the state; a service that has started but is not ready counts as starting."""
        if self.state is InterfaceState.READY and self.service is not None and not self.service.ready:
            return InterfaceState.STARTING
        return self.state

    def describe(self, *, details: bool = True) -> dict[str, Any]:
        """Return plain JSON values; without details only state and port: others can contain paths and clients' data."""
        described: dict[str, Any] = {"state": self.current().value}
        if not details:
            port = (
                self.figures().get("port") if self.figures is not None and self.state is InterfaceState.READY else None
            )
            return described if port is None else {**described, "port": port}
        if self.where:
            described["where"] = self.where
        if self.problem:
            described["problem"] = encodable(self.problem)
        if self.progress is not None and self.state is InterfaceState.STARTING:
            described.update(self.progress())
        if self.figures is not None and self.state is InterfaceState.READY:
            described.update(self.figures())
        if warnings := [*described.get("warnings", ()), *self.warnings.listed()]:
            described["warnings"] = [encodable(warning) for warning in warnings]
        return described


@dataclass(slots=True)
class ServiceRegistry:
    """Entries by name, in order of start."""

    essential: frozenset[str] = frozenset()
    """Entries without which the process is not ready; failures of others only degrade it."""
    entries: dict[str, Entry] = field(default_factory=dict)

    def expect(self, *names: str) -> None:
        """Add entries that are going to start; the process is not ready before them."""
        for name in names:
            self.entries.setdefault(name, Entry())

    def ready(
        self,
        name: str,
        *,
        where: str = "",
        service: Service | None = None,
        figures: Callable[[], Mapping[str, Any]] | None = None,
    ) -> None:
        """Mark an entry as started; a ``service`` is ready when its own ``ready`` is true."""
        if figures is None and service is not None:
            figures = service.status
        entry = Entry(InterfaceState.READY, service=service, figures=figures, where=where)
        if name in self.entries:
            entry.warnings = self.entries[name].warnings
        self.entries[name] = entry

    def warn(self, name: str, subject: str, *sentences: str) -> None:
        """Replace an entry's warnings about a subject, such as a file."""
        self.entries.setdefault(name, Entry()).warnings.set(subject, *sentences)

    def fail(self, name: str, problem: str) -> None:
        """Mark an entry as failed; ``problem`` is one sentence."""
        entry = self.entries.setdefault(name, Entry())
        entry.state, entry.problem = InterfaceState.FAILED, problem

    def stop(self) -> None:
        """Mark all entries that have not failed as stopped."""
        for entry in self.entries.values():
            if entry.state is not InterfaceState.FAILED:
                entry.state = InterfaceState.STOPPED

    def verdict(self) -> str:
        """Return ``ready``, ``degraded`` (an interface failed), ``starting``, ``stopping`` or ``failed``."""
        states = {name: entry.current() for name, entry in self.entries.items()}
        if any(states.get(name) is InterfaceState.FAILED for name in self.essential):
            return "failed"
        for state, verdict in (
            (InterfaceState.STOPPED, "stopping"),
            (InterfaceState.STARTING, "starting"),
            (InterfaceState.FAILED, "degraded"),
        ):
            if state in states.values():
                return verdict
        return "ready"

    def describe(self, *, details: bool = True) -> dict[str, Any]:
        """Return the verdict and all entries as plain JSON values, see ``Entry.describe``."""
        return {
            "status": self.verdict(),
            "interfaces": {name: entry.describe(details=details) for name, entry in self.entries.items()},
        }


def one_line(error: BaseException) -> str:
    """Return an exception as one line of text."""
    text = " ".join(str(error).split())
    return text if text and not isinstance(error, KeyError) else f"{type(error).__name__}: {text}"
