"""Execute a request on the live tree: deletes, geometries, transforms, properties."""

from __future__ import annotations

from itertools import islice

from gateway.runtime.warning_list import WarningList
from gateway.scene.live import LiveTree
from gateway.scene.tree import Path, TreeEdit
from gateway.treeviewer.config import Limits
from gateway.treeviewer.quota import TreeQuota
from gateway.treeviewer.requests import Finding, Request, Subject
from gateway.treeviewer.responses import ERROR_HANDLING_REQUEST, MISSING_PATHS, OK, CommandProblem, Response


class RequestApplier:
    """Executes one request, in one or several steps. Each step creates one revision of the live tree."""

    def __init__(
        self, request: Request, live: LiveTree, quota: TreeQuota, limits: Limits, warnings: WarningList
    ) -> None:
        self.request = request
        self._warnings = warnings
        self._live = live
        self._quota = quota
        self._limits = limits
        self._remaining = request.commands
        self._deletes = iter(request.deletes)
        self._geometries = iter(enumerate(request.geometries))
        self._transforms = iter(enumerate(request.transforms))
        self._properties = iter(enumerate(request.properties))
        self._failures = request.failures
        self._added: dict[Path, None] = {}
        """Paths whose geometry was set, in order; the values have no meaning."""
        self._transformed: dict[Path, None] = {}
        """Paths whose transform was set."""
        self._missing: dict[Path, None] = {}
        """Paths whose transform or properties were set, but which have no geometry at or below them."""

    def step(self, max_commands: int) -> bool:
        """Execute up to ``max_commands`` commands; return True if commands remain."""
        if not self._remaining:
            return False
        with self._live.edit() as edit:
            executed = self._delete(edit, max_commands)
            executed += self._set_geometry(edit, max_commands - executed)
            executed += self._set_transform(edit, max_commands - executed)
            executed += self._set_properties(edit, max_commands - executed)
        self._remaining -= executed
        return self._remaining > 0

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
            response.errors = [
                CommandProblem(failure.command, failure.index, _valid_text(failure.reason), failure.path)
                for failure in self._failures[:limit]
            ]
        if self.request.warnings:
            response.warnings = [_valid_text(warning.text) for warning in self.request.warnings[:limit]]
        response.newer_commands = self.request.newer_commands
        return response

    def _update_warnings(self) -> None:
        """Replace the warnings about what the request has deleted or set, and those about commands without a path."""
        request, warnings = self.request, self._warnings
        if warnings:
            deleted = set(request.deletes)
            warnings.remove(lambda subject: _is_below(subject[1], deleted))
            for subject in request.subjects():
                warnings.set(subject)
        found: dict[Subject, list[str]] = {}
        for finding in (*request.warnings, *self._failures):
            found.setdefault((finding.command, finding.path), []).append(_valid_text(finding.text))
        for subject, sentences in found.items():
            warnings.set(subject, *sentences)

    def _delete(self, edit: TreeEdit, max_commands: int) -> int:
        """Execute up to ``max_commands`` deletes; return how many."""
        count = 0
        for path in islice(self._deletes, max_commands):
            edit.delete(path)
            count += 1
        return count

    def _set_geometry(self, edit: TreeEdit, max_commands: int) -> int:
        """Execute up to ``max_commands`` setgeometry commands; return how many, including failed ones."""
        count = 0
        quota = self._quota
        for index, (path, parts) in islice(self._geometries, max_commands):
            count += 1
            reason = quota.check(edit.root, path, len(parts)) or quota.reserve(parts)
            if reason:
                self._failures.append(Finding("setgeometry", index, path, reason))
                continue
            edit.set_parts(path, parts)
            quota.add_parts(len(parts))
            self._added[path] = None
        return count

    def _set_transform(self, edit: TreeEdit, max_commands: int) -> int:
        """Execute up to ``max_commands`` settransform commands; return how many, including failed ones."""
        count = 0
        for index, (path, pose) in islice(self._transforms, max_commands):
            count += 1
            reason = self._quota.check(edit.root, path)
            if reason:
                self._failures.append(Finding("settransform", index, path, reason))
                continue
            if not edit.set_pose(path, pose).nodes_with_parts:
                self._missing[path] = None
            self._transformed[path] = None
        return count

    def _set_properties(self, edit: TreeEdit, max_commands: int) -> int:
        """Execute up to ``max_commands`` setproperty commands; return how many, including failed ones."""
        count = 0
        for index, (path, visible, opacity) in islice(self._properties, max_commands):
            count += 1
            reason = self._quota.check(edit.root, path)
            if reason:
                self._failures.append(Finding("setproperty", index, path, reason))
                continue
            if visible is not None:
                edit.set_visible(path, visible)
            if opacity is not None:
                edit.set_opacity(path, opacity)
            node = edit.root.find(path)
            if node is None or not node.nodes_with_parts:
                self._missing[path] = None
        return count


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
