"""Execute a request on the live tree: deletes, then geometries, then transforms."""

from __future__ import annotations

from itertools import islice

from gateway.scene.live import LiveTree
from gateway.scene.tree import Path, TreeEdit
from gateway.treeviewer.config import Limits
from gateway.treeviewer.quota import TreeQuota
from gateway.treeviewer.requests import Failure, Request
from gateway.treeviewer.responses import ERROR_HANDLING_REQUEST, MISSING_PATHS, OK, CommandProblem, Response


class RequestApplier:
    """Executes one request in one step or in several, each of them one revision of the tree."""

    def __init__(self, request: Request, live: LiveTree, quota: TreeQuota, limits: Limits) -> None:
        self._request = request
        self._live = live
        self._quota = quota
        self._limits = limits
        self._remaining = request.commands
        self._deletes = iter(request.deletes)
        self._geometries = iter(enumerate(request.geometries))
        self._transforms = iter(enumerate(request.transforms))
        self._failures = request.failures
        self._added: dict[Path, None] = {}
        self._moved: dict[Path, None] = {}
        self._missing: dict[Path, None] = {}

    def step(self, max_commands: int) -> bool:
        """Execute up to ``max_commands`` commands; return whether any remain."""
        if not self._remaining:
            return False
        with self._live.edit() as edit:
            left = max_commands
            left -= self._delete(edit, left)
            left -= self._set_geometry(edit, left)
            left -= self._set_transform(edit, left)
        self._remaining -= max_commands - left
        return self._remaining > 0

    def response(self, utime: int) -> Response:
        """Return the response to the request."""
        response = Response(
            utime,
            MISSING_PATHS if self._missing else OK,
            list(dict.fromkeys(self._request.deletes)),
            list(self._added),
            list(self._moved),
            list(self._missing),
        )
        limit = self._limits.problems
        if self._failures:
            response.status = ERROR_HANDLING_REQUEST
            response.error = _valid_text(_summary(self._failures))
            response.errors = [
                CommandProblem(f.command, f.index, _valid_text(f.reason), f.path) for f in self._failures[:limit]
            ]
        if self._request.warnings:
            response.warnings = [_valid_text(text) for text in self._request.warnings[:limit]]
        return response

    def _delete(self, edit: TreeEdit, max_commands: int) -> int:
        """Execute deletes; return their number, as the next two methods do."""
        count = 0
        for path in islice(self._deletes, max_commands):
            edit.delete(path)
            count += 1
        return count

    def _set_geometry(self, edit: TreeEdit, max_commands: int) -> int:
        count = 0
        quota = self._quota
        for index, (path, parts) in islice(self._geometries, max_commands):
            count += 1
            refused = quota.check(edit.root, path, len(parts)) or quota.reserve_arrays(parts)
            if refused:
                self._failures.append(Failure("setgeometry", index, path, refused))
                continue
            edit.set_parts(path, parts)
            quota.add_parts(len(parts))
            self._added[path] = None
        return count

    def _set_transform(self, edit: TreeEdit, max_commands: int) -> int:
        count = 0
        check = self._quota.check
        for index, (path, pose) in islice(self._transforms, max_commands):
            count += 1
            refused = check(edit.root, path)
            if refused:
                self._failures.append(Failure("settransform", index, path, refused))
                continue
            if not edit.set_pose(path, pose).nodes_with_parts:
                self._missing[path] = None
            self._moved[path] = None
        return count


def _valid_text(text: str) -> str:
    """Replace lone surrogates, which clients' names may contain and UTF-8 cannot represent."""
    return text.encode("utf-8", "replace").decode()


def _summary(failures: list[Failure]) -> str:
    first = failures[0]
    path = "" if first.path is None else f" {list(first.path)}"
    more = f" (and {len(failures) - 1} more)" if len(failures) > 1 else ""
    return f"{first.command}[{first.index}]{path}: {first.reason}{more}"
