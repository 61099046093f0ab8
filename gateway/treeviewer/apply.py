"""Carries out a request on the live tree: deletes, then geometries, then transforms, and says what came of it."""

from __future__ import annotations

from collections.abc import Sequence

from gateway.scene.live import LiveTree
from gateway.scene.tree import Path, TreeEdit
from gateway.treeviewer.answers import ERROR_HANDLING_REQUEST, MISSING_PATHS, OK, Answer, Problem
from gateway.treeviewer.config import Limits
from gateway.treeviewer.quota import Census
from gateway.treeviewer.requests import Failure, Request


class Application:
    """A request on its way into the tree; one of many commands goes in several steps, each one revision of the tree."""

    __slots__ = ("_added", "_at", "_booked", "_census", "_failures", "_limits", "_live", "_missing", "_request", "_set")

    def __init__(self, request: Request, live: LiveTree, census: Census, limits: Limits) -> None:
        self._request = request
        self._live = live
        self._census = census
        self._limits = limits
        self._at = [0, 0, 0]
        self._booked = 0
        self._failures = request.failures
        self._added: dict[Path, None] = {}
        self._set: dict[Path, None] = {}
        self._missing: dict[Path, None] = {}

    def step(self, most: int) -> bool:
        """Carries out up to ``most`` commands; returns whether any remain."""
        request, at = self._request, self._at
        if not request.commands:
            return False
        with self._live.edit() as edit:
            self._booked = 0
            if request.deletes:
                most -= self._delete(edit, most)
            if request.geometries:
                most -= self._set_geometry(edit, most)
            if request.transforms:
                self._set_transform(edit, most)
            self._book(edit)
        return at[0] < len(request.deletes) or at[1] < len(request.geometries) or at[2] < len(request.transforms)

    def _delete(self, edit: TreeEdit, most: int) -> int:
        begin = self._at[0]
        paths = self._request.deletes[begin : begin + most]
        for path in paths:
            edit.delete(path)
        self._at[0] += len(paths)
        return len(paths)

    def _set_geometry(self, edit: TreeEdit, most: int) -> int:
        begin = self._at[1]
        geometries = self._request.geometries
        commands = geometries if begin == 0 and most >= len(geometries) else geometries[begin : begin + most]
        census, added, set_parts = self._census, self._added, edit.set_parts
        full = not census.surely_room(_most_nodes(commands), sum(len(parts) for _, parts in commands))
        for index, (path, parts) in enumerate(commands, begin):
            refused = ""
            if full:
                self._book(edit)
                refused = census.room(edit.root, _new_nodes(edit, path), len(parts))
            refused = refused or census.admit(parts)
            if refused:
                self._failures.append(Failure("setgeometry", index, path, refused))
                continue
            set_parts(path, parts)
            census.parts += len(parts)
            added[path] = None
        self._book(edit)
        self._at[1] += len(commands)
        return len(commands)

    def _set_transform(self, edit: TreeEdit, most: int) -> None:
        begin = self._at[2]
        transforms = self._request.transforms
        commands = transforms if begin == 0 and most >= len(transforms) else transforms[begin : begin + most]
        census, missing, set_pose = self._census, self._missing, edit.set_pose
        full = not census.surely_room(_most_nodes(commands), 0)
        for index, (path, pose) in enumerate(commands, begin):
            if full:
                self._book(edit)
                refused = census.room(edit.root, _new_nodes(edit, path), 0)
                if refused:
                    self._failures.append(Failure("settransform", index, path, refused))
                    continue
            if not set_pose(path, pose).geometry_count:
                missing[path] = None
            self._set[path] = None
        self._at[2] += len(commands)

    def _book(self, edit: TreeEdit) -> None:
        """Tells the census of the nodes that were made since the last time."""
        self._census.nodes += edit.created - self._booked
        self._booked = edit.created

    def answer(self, utime: int) -> Answer:
        """What the client is told."""
        answer = Answer(
            utime,
            MISSING_PATHS if self._missing else OK,
            list(dict.fromkeys(self._request.deletes)),
            list(self._added),
            list(self._set),
            list(self._missing),
        )
        most = self._limits.problems
        if self._failures:
            answer.status = ERROR_HANDLING_REQUEST
            answer.error = _clean(_summary(self._failures))
            answer.errors = [Problem(f.command, f.index, _clean(f.reason), f.path) for f in self._failures[:most]]
        if self._request.warnings:
            answer.warnings = [_clean(text) for text in self._request.warnings[:most]]
        return answer


def _most_nodes(commands: Sequence[tuple[Path, object]]) -> int:
    """How many nodes ``commands`` can bring into being."""
    return sum([len(path) for path, _ in commands])


def _new_nodes(edit: TreeEdit, path: Path) -> int:
    """How many nodes ``path`` would bring into being."""
    node = edit.root
    for depth, element in enumerate(path):
        child = node.children.get(element)
        if child is None:
            return len(path) - depth
        node = child
    return 0


def _clean(text: str) -> str:
    """Half characters (lone surrogates), which a client's names can have, cannot be sent."""
    return text.encode("utf-8", "replace").decode()


def _summary(failures: list[Failure]) -> str:
    first = failures[0]
    where = "" if first.path is None else f" {list(first.path)}"
    more = f" (and {len(failures) - 1} more)" if len(failures) > 1 else ""
    return f"{first.command}[{first.index}]{where}: {first.reason}{more}"
