"""What runs and in which state: the source of ``/healthz``, ``/readyz`` and the lines at start."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol


class Service(Protocol):
    """A long-running interface."""

    async def run(self) -> None:
        """Works until cancelled and cleans up behind itself; raises when it cannot work."""

    @property
    def ready(self) -> bool:
        """Whether clients can use it now."""

    def status(self) -> Mapping[str, Any]:
        """Figures and warnings for ``/healthz``; plain JSON values."""


class State(StrEnum):
    STARTING = "starting"
    READY = "ready"
    FAILED = "failed"
    STOPPED = "stopped"


@dataclass(slots=True)
class Entry:
    """One interface, or the kernels, on the board."""

    state: State = State.STARTING
    problem: str = ""
    """One sentence, when failed."""
    service: Service | None = None
    figures: Callable[[], Mapping[str, Any]] | None = None
    """Plain JSON values for ``/healthz``."""
    where: str = ""
    """How clients reach it, for people."""
    progress: Callable[[], Mapping[str, Any]] | None = None
    """Plain JSON values for ``/healthz`` while it starts."""

    def current(self) -> State:
        """The state, a running service's own word included."""
        if self.state is State.READY and self.service is not None and not self.service.ready:
            return State.STARTING
        return self.state

    def describe(self, *, details: bool = True) -> dict[str, Any]:
        """Plain JSON values.

        Args:
            details: False: state and port alone. Problems, places and figures can have paths and clients' data in them.
        """
        described: dict[str, Any] = {"state": self.current().value}
        if not details:
            port = self.figures().get("port") if self.figures is not None and self.state is State.READY else None
            return described if port is None else {**described, "port": port}
        if self.where:
            described["where"] = self.where
        if self.problem:
            described["problem"] = self.problem
        if self.progress is not None and self.state is State.STARTING:
            described.update(self.progress())
        if self.figures is not None and self.state is State.READY:
            described.update(self.figures())
        return described


@dataclass(slots=True)
class Board:
    """The entries by name, in order of start."""

    essential: frozenset[str] = frozenset()
    """Entries without which the process is not ready; the failure of another one only degrades it."""
    entries: dict[str, Entry] = field(default_factory=dict)

    def expect(self, *names: str) -> None:
        """Announces what will start, so that readiness waits for it."""
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
        """The entry works from now on (a service: as far as it says so itself)."""
        if figures is None and service is not None:
            figures = service.status
        self.entries[name] = Entry(State.READY, "", service, figures, where)

    def fail(self, name: str, problem: str) -> None:
        """The entry does not work; ``problem`` is one sentence for people."""
        entry = self.entries.setdefault(name, Entry())
        entry.state, entry.problem = State.FAILED, problem

    def stop(self) -> None:
        """Nothing new is taken any more."""
        for entry in self.entries.values():
            if entry.state is not State.FAILED:
                entry.state = State.STOPPED

    def verdict(self) -> str:
        """``ready``, ``degraded`` (works, but an interface failed), ``starting``, ``stopping`` or ``failed``."""
        states = {name: entry.current() for name, entry in self.entries.items()}
        if any(states.get(name) is State.FAILED for name in self.essential):
            return "failed"
        for state, verdict in ((State.STOPPED, "stopping"), (State.STARTING, "starting"), (State.FAILED, "degraded")):
            if state in states.values():
                return verdict
        return "ready"

    def describe(self, *, details: bool = True) -> dict[str, Any]:
        """Plain JSON values: the verdict and every entry, see ``Entry.describe``."""
        return {
            "status": self.verdict(),
            "interfaces": {name: entry.describe(details=details) for name, entry in self.entries.items()},
        }
