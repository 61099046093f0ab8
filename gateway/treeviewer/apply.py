"""Execute a request on the live tree: deletes, geometries, transforms, properties."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from itertools import islice

import msgspec

from gateway.runtime.warning_list import WarningList
from gateway.scene.geometry import Part
from gateway.scene.live import LiveTree
from gateway.scene.tree import Path, TreeEdit
from gateway.treeviewer.config import Limits
from gateway.treeviewer.quota import TreeQuota
from gateway.treeviewer.requests import Finding, Request, Subject
from gateway.treeviewer.responses import Response
from scenegate.messages.wire import ERROR_HANDLING_REQUEST, MISSING_PATHS, OK


class RequestApplier:
    """Executes one request on a private copy of the live tree, and publishes the result as one revision."""

    def __init__(
        self, request: Request, live: LiveTree, quota: TreeQuota, limits: Limits, warnings: WarningList
    ) -> None:
        self.request = request
        self._warnings = warnings
        self._live = live
        self._quota = quota
        self._limits = limits
        self._failures = request.failures
        self._added: dict[Path, None] = {}
        """Paths whose geometry was set, in order; the values have no meaning."""
        self._transformed: dict[Path, None] = {}
        """Paths whose transform was set."""
        self._missing: dict[Path, None] = {}
        """Paths whose transform or properties were set, but which have no geometry at or below them."""

    def apply(self, timestamp: int | None = None) -> None:
        """Execute the request at once; the result is valid from ``timestamp``, as in ``LiveTree.edit``."""
        edit = TreeEdit(self._live.snapshot.root)
        for _ in self._execute(edit):
            pass
        self._live.publish(edit, timestamp)

    def slices(self, max_commands: int, timestamp: int | None = None) -> Iterator[None]:
        """Execute the request; yield after every ``max_commands`` commands. Nothing is visible before the end."""
        edit = TreeEdit(self._live.snapshot.root)
        commands = self._execute(edit)
        while deque(islice(commands, max_commands), maxlen=1):
            self._quota.unpublished_nodes = max(0, edit.root.node_count - edit.base.node_count)
            try:
                yield
            finally:
                self._quota.unpublished_nodes = 0
        self._live.publish(edit, timestamp)

    def response(self, utime: int) -> Response:
        """Return the response to the request, and update the warnings about the paths in it."""
        self._update_warnings()
        response = Response(
            utime,
            MISSING_PATHS if self._missing else OK,
            list(dict.fromkeys(self.request.deletes)),
            list(self._added),
            list(self._transformed),
            list(self._missing),
        )
        limit = self._limits.problems
        if self._failures:
            response.status = ERROR_HANDLING_REQUEST
            response.error = _valid_text(_summary(self._failures))
            for failure in self._failures[:limit]:
                response.errors.append(msgspec.structs.replace(failure, reason=_valid_text(failure.reason)))
        if self.request.warnings:
            response.warnings = [_valid_text(warning.text) for warning in self.request.warnings[:limit]]
        response.newer_commands = self.request.newer_commands
        return response

    def _update_warnings(self) -> None:
        """Replace the warnings about what the request has deleted or set, and those about commands without a path."""
        request, warnings = self.request, self._warnings
        if warnings.sentences:
            deleted = set(request.deletes)
            warnings.remove(lambda subject: _is_below(subject[1], deleted))
            for subject in request.subjects():
                warnings.set(subject)
        found: dict[Subject, list[str]] = {}
        for finding in (*request.warnings, *self._failures):
            found.setdefault((finding.command, finding.path), []).append(_valid_text(finding.text))
        for subject, sentences in found.items():
            warnings.set(subject, *sentences)

    def _execute(self, edit: TreeEdit) -> Iterator[None]:
        """Execute the commands; yield after each one, failed ones included."""
        for path in self.request.deletes:
            edit.delete(path)
            yield
        for index, (path, parts) in enumerate(self.request.geometries):
            self._set_geometry(edit, index, path, parts)
            yield
        for index, (path, pose) in enumerate(self.request.transforms):
            if edit.root.find(path) is not None or self._has_room(edit, "settransform", index, path):
                self._transformed[path] = None
                if not edit.set_pose(path, pose).nodes_with_parts:
                    self._missing[path] = None
            yield
        for index, (path, visible, opacity) in enumerate(self.request.properties):
            if edit.root.find(path) is not None or self._has_room(edit, "setproperty", index, path):
                self._set_properties(edit, path, visible, opacity)
            yield

    def _has_room(self, edit: TreeEdit, command: str, index: int, path: Path, parts: tuple[Part, ...] = ()) -> bool:
        """Return True if the limits allow a command; else add a failure."""
        node_count = edit.root.node_count + self._live.snapshot.root.node_count - edit.base.node_count
        reason = self._quota.refusal(edit.root, node_count, path, len(parts))
        if parts and not reason:
            reason = self._quota.reserve(parts)
        if reason:
            self._failures.append(Finding(command, index, reason, path))
        return not reason

    def _set_geometry(self, edit: TreeEdit, index: int, path: Path, parts: tuple[Part, ...]) -> None:
        if self._has_room(edit, "setgeometry", index, path, parts):
            edit.set_parts(path, parts)
            self._quota.add_parts(len(parts))
            self._added[path] = None

    def _set_properties(self, edit: TreeEdit, path: Path, visible: bool | None, opacity: float | None) -> None:
        if visible is not None:
            edit.set_visible(path, visible)
        if opacity is not None:
            edit.set_opacity(path, opacity)
        node = edit.root.find(path)
        if node is None or not node.nodes_with_parts:
            self._missing[path] = None


def _is_below(path: Path | None, deleted: set[Path]) -> bool:
    """Return True if a path or one above it was deleted."""
    return path is not None and any(path[:depth] in deleted for depth in range(len(path) + 1))


def _valid_text(text: str) -> str:
    """Replace lone surrogates. JSON strings of clients may contain them, and UTF-8 cannot encode them."""
    return text.encode("utf-8", "replace").decode()


def _summary(failures: list[Finding]) -> str:
    """Return the first failure's command, path and reason, and the number of other failures."""
    more = f" (and {len(failures) - 1} more)" if len(failures) > 1 else ""
    return failures[0].text + more
