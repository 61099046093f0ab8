"""Results of requests: ``Answer``, and the error for commands that the viewer rejected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from scenegate.messages.changes import Path
from scenegate.messages.request_encoding import Response
from scenegate.messages.wire import MISSING_PATHS, OK

UNSUPPORTED: Final = -4
"""Status of an ``Answer`` if the viewer ignored a command. This client sets it; no viewer sends it."""


class TreeViewerError(RuntimeError):
    """The viewer rejected at least one command of a request. It executed the other commands."""

    def __init__(self, answer: Answer) -> None:
        super().__init__(answer.error or f"the viewer answered with status {answer.status}")
        self.answer = answer


@dataclass(frozen=True, slots=True)
class Answer:
    """Result of a request.

    Attributes:
        status: Status of the response (``scenegate.messages.wire``), or ``UNSUPPORTED``.
        deleted: Deleted paths.
        added: Paths with new geometry.
        transformed: Paths with a new transform.
        missing: Paths with a new transform that have no geometry at or below them, and that this client has not
            published.
        warnings: One sentence for each irregularity that the viewer tolerated and each geometry that it cannot draw.
        error: Reason of the first failure; empty if no command failed.
    """

    status: int
    deleted: tuple[Path, ...] = ()
    added: tuple[Path, ...] = ()
    transformed: tuple[Path, ...] = ()
    missing: tuple[Path, ...] = ()
    warnings: tuple[str, ...] = ()
    error: str = ""


def answer_of(response: Response, missing: list[Path]) -> Answer:
    """Return the result of a request; ``missing`` are paths without geometry that the client has not published."""
    body = response.body

    def paths(name: str) -> tuple[Path, ...]:
        return tuple(tuple(path) for path in body.get(name, ()))

    status = response.status
    if status == MISSING_PATHS and not missing:
        status = OK
    errors = body.get("errors", ())
    failure_count = f" ({len(errors)} commands failed)" if len(errors) > 1 else ""
    return Answer(
        status,
        paths("deleted_paths"),
        paths("added_geometries"),
        paths("set_transforms"),
        tuple(missing),
        tuple(body.get("warnings", ())),
        f"{body.get('error', '')}{failure_count}",
    )
