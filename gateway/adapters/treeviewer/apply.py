"""Execute a request: ``RequestApplier`` on the live tree, ``update_page`` on the state of the browser pages."""

from collections import deque
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import msgspec

from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.quota import TreeQuota
from gateway.adapters.treeviewer.requests import Finding, Request, Subject
from gateway.adapters.treeviewer.responses import ClickMessage, ControlsMessage, ControlValue, PageMessage, Response
from gateway.runtime.logs.warning_list import WarningList
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Path, TreeEdit
from scenegate.messages.controls import Value
from scenegate.messages.wire import ERROR_HANDLING_REQUEST, MISSING_PATHS, OK
from scenegate.printable import encodable


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
        while _advance(commands, max_commands):
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
            more = f" (and {len(self._failures) - 1} more)" if len(self._failures) > 1 else ""
            response.error = encodable(self._failures[0].text + more)
            for failure in self._failures[:limit]:
                response.errors.append(msgspec.structs.replace(failure, reason=encodable(failure.reason)))
        if self.request.warnings:
            response.warnings = [encodable(warning.text) for warning in self.request.warnings[:limit]]
        response.newer_commands = self.request.newer_commands
        return response

    def _update_warnings(self) -> None:
        """Replace the warnings about what the request has deleted or set, and those about commands without a path."""
        request, warnings = self.request, self._warnings
        if warnings.sentences:
            deleted = set(request.deletes)
            warnings.remove(lambda subject: _is_at_or_below(subject[1], deleted))
            for subject in request.subjects():
                warnings.set(subject)
        found: dict[Subject, list[str]] = {}
        for finding in (*request.warnings, *self._failures):
            found.setdefault((finding.command, finding.path), []).append(encodable(finding.text))
        for subject, sentences in found.items():
            warnings.set(subject, *sentences)

    def _execute(self, edit: TreeEdit) -> Iterator[None]:
        """Execute the commands; yield after each one, failed ones included."""
        for path in self.request.deletes:
            edit.delete(path)
            yield
        for index, (path, parts) in enumerate(self.request.geometries):
            if self._has_room(edit, "setgeometry", index, path, parts):
                edit.set_parts(path, parts)
                self._added[path] = None
            yield
        for index, (path, pose) in enumerate(self.request.transforms):
            if edit.root.find(path) is not None or self._has_room(edit, "settransform", index, path):
                self._transformed[path] = None
                if not edit.set_pose(path, pose).nodes_with_parts:
                    self._missing[path] = None
            yield
        for index, (path, visible, opacity) in enumerate(self.request.properties):
            if edit.root.find(path) is not None or self._has_room(edit, "setproperty", index, path):
                if visible is not None:
                    edit.set_visible(path, visible)
                if opacity is not None:
                    edit.set_opacity(path, opacity)
                node = edit.root.find(path)
                if node is None or not node.nodes_with_parts:
                    self._missing[path] = None
            yield

    def _has_room(self, edit: TreeEdit, command: str, index: int, path: Path, parts: tuple[Part, ...] = ()) -> bool:
        """Return True if the limits allow a command; else add a failure."""
        node_count = edit.root.node_count + self._live.snapshot.root.node_count - edit.base.node_count
        reason = self._quota.admit(edit.root, node_count, path, parts)
        if reason:
            self._failures.append(Finding(command, index, reason, path))
        return not reason


def _advance(commands: Iterator[None], count: int) -> bool:
    """Execute up to ``count`` commands; return False if there was none left."""
    return bool(deque(islice(commands, count), maxlen=1))


def _is_at_or_below(path: Path | None, tops: set[Path]) -> bool:
    return path is not None and any(path[:depth] in tops for depth in range(len(path) + 1))


@dataclass(frozen=True, slots=True)
class PageClient:
    """The client that sent a request, as a receiver of clicks and values from the page."""

    key: Hashable | None
    """Identifies the client; None without a client id, because clients without an id share a channel."""
    send: Callable[[PageMessage], None]

    def send_values(self, values: Sequence[tuple[Path, Value]], after: int) -> None:
        """Send values of controls. See ``gateway.scene.page.control_store.Deliver``."""
        self.send(ControlsMessage([ControlValue(path, value) for path, value in values], after))


def update_page(page: LivePage, request: Request, client: PageClient | None, utime: int) -> None:
    """Execute a request's commands for the page; add a failure to the request for each that cannot be executed.

    ``client``: the sender; None if it cannot receive messages of the page.
    """
    if request.view is not None:
        page.change_view(request.view)
    if request.click_paths is None and request.controls is None and not request.control_changes:
        return
    if client is None or client.key is None:
        for name in sorted({"setclicks", "setcontrols", "setvalues"} & set(request.newer_commands)):
            reason = "clicks and values are sent only on a channel with a client id"
            request.failures.append(Finding(name, 0, reason))
        return
    if request.click_paths is not None:
        reason = page.clicks.subscribe(client.key, request.click_paths, lambda click: client.send(ClickMessage(click)))
        if reason:
            request.failures.append(Finding("setclicks", 0, reason))
        else:
            page.notify()
    if request.controls is not None:
        reason = page.controls.set_controls(client.key, request.controls, client.send_values, utime)
        if reason:
            request.failures.append(Finding("setcontrols", 0, reason))
    for change in request.control_changes:
        try:
            if change.samples is not None:
                page.controls.add_samples(client.key, change.path, change.samples, utime)
            else:
                page.controls.set_value(client.key, change.path, change.value, utime)
        except ValueError as error:
            request.failures.append(Finding("setvalues", change.index, str(error), change.path))
