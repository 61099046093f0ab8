"""The client: ``viewer["robot"]["base"].set(Box((1, 1, 1)))``."""

from __future__ import annotations

import contextlib
import itertools
import os
import secrets
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Final

from numpy.typing import ArrayLike

from gateway.client.tree import wire
from gateway.client.tree.geometry import Geometry, Transform
from gateway.client.tree.link import Link
from gateway.client.tree.memory import Changes, Memory, Path, path_of

OK, MISSING_PATHS, UNKNOWN_FORMAT, UNKNOWN_VERSION = 0, 1, -1, -2


class TreeViewerError(RuntimeError):
    """The viewer refused something; what it could do was done."""

    def __init__(self, answer: Answer) -> None:
        super().__init__(answer.error or f"the viewer answered with status {answer.status}")
        self.answer = answer


@dataclass(frozen=True, slots=True)
class Answer:
    """What the viewer made of a request."""

    status: int
    deleted: tuple[Path, ...] = ()
    added: tuple[Path, ...] = ()
    transformed: tuple[Path, ...] = ()
    missing: tuple[Path, ...] = ()
    """Given a transform, but without geometry at or below them, there and here."""
    warnings: tuple[str, ...] = ()
    """Sentences about what was tolerated or cannot be drawn."""
    error: str = ""


class Node:
    """A path. Numbers and names go on downwards: ``node["arm"][0]``, ``node["arm", 0]``, ``node["arm/hand"]``."""

    __slots__ = ("_to", "path")

    def __init__(self, to: TreeViewer | Batch, path: Path) -> None:
        self._to = to
        self.path = path

    def __getitem__(self, key: str | int | tuple[str | int, ...]) -> Node:
        return Node(self._to, self.path + path_of(key))

    def set(self, *geometries: Geometry, transform: Transform | ArrayLike | None = None) -> Answer:
        """Replaces the geometry here, and the transform if one is given; children stay. None: empty."""
        for geometry in geometries:
            if not isinstance(geometry, Geometry):
                raise TypeError(f"set takes geometries such as Box((1, 1, 1)), not {_shown(geometry)}")
        changes = Changes()
        changes.set(self.path, [geometry.body() for geometry in geometries])
        if transform is not None:
            changes.transform(self.path, Transform.of(transform).body())
        return self._to.send(changes)

    def transform(self, value: Transform | ArrayLike) -> Answer:
        """Replaces the transform here: (4, 4), three numbers or a ``Transform``; child to parent."""
        changes = Changes()
        changes.transform(self.path, Transform.of(value).body())
        return self._to.send(changes)

    def delete(self) -> Answer:
        """Removes this and all below."""
        changes = Changes()
        changes.delete(self.path)
        return self._to.send(changes)


class Batch:
    """Collects; all of it becomes visible at once. Later calls win over earlier ones of the same path."""

    def __init__(self) -> None:
        self.changes = Changes()
        self.answer: Answer | None = None
        """Of the viewer, once the block has ended."""

    def __getitem__(self, key: str | int | tuple[str | int, ...]) -> Node:
        return Node(self, path_of(key))

    def send(self, changes: Changes) -> Answer:
        """Adds to what is collected."""
        for path in changes.deleted:
            self.changes.delete(path)
        for path, entry in changes.entries.items():
            if entry.geometries is not None:
                self.changes.set(path, entry.geometries)
            if entry.transform is not None:
                self.changes.transform(path, entry.transform)
        return Answer(OK)


class TreeViewer:
    """A connection to a viewer, ours or any other of Director's protocol. Safe to use from several threads.

    Remembers what it published: a viewer that misses something, or has started again, gets it again.
    """

    _numbers = itertools.count()

    def __init__(self, url: str | None = None, timeout: float = 5.0, binary: bool | None = None) -> None:
        """
        Args:
            url: of the LCM network (``tcpq://host:7700``, ``udpm://...``); None: LCM_DEFAULT_URL, or LCM's default.
            timeout: seconds to wait for an answer, or for a hub to appear.
            binary: whether requests go in MessagePack; None: where the viewer offers it.
        Raises:
            ConnectionError, ImportError: LCM does not work here; the message says why.
        """
        self.timeout = timeout
        self._wanted = binary
        self._format: str | None = {None: None, True: wire.BINARY, False: wire.JSON}[binary]
        self._memory = Memory()
        self._lock = threading.Lock()
        self._utime = 0
        self._waiting: dict[int, Future[wire.Reply]] = {}
        self.client_id = f"sg{os.getpid()}_{next(self._numbers)}_{secrets.token_hex(4)}"
        handlers = {f"{wire.RESPONSE}_<{self.client_id}>": self._answered, wire.RESPONSE: self._announced}
        self._link = Link(url, handlers, timeout)

    @property
    def url(self) -> str:
        """Of the LCM network."""
        return self._link.url

    def __getitem__(self, key: str | int | tuple[str | int, ...]) -> Node:
        return Node(self, path_of(key))

    def __enter__(self) -> TreeViewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the connection; what was published stays in the viewer."""
        self._link.close()

    def delete(self) -> Answer:
        """Removes everything in the viewer, whoever published it."""
        return Node(self, ()).delete()

    @contextmanager
    def batch(self) -> Iterator[Batch]:
        """One request for all that happens to the batch within the block; nothing is sent if the block raises."""
        batch = Batch()
        yield batch
        batch.answer = self.send(batch.changes)

    def send(self, changes: Changes) -> Answer:
        """Publishes, waits for the answer, and gives the viewer what it misses.

        Raises:
            TreeViewerError: the viewer refused something.
            TimeoutError: no answer came in time.
            ConnectionError: the network has gone.
        """
        with self._lock:
            self._memory.take(changes)
        reply = self._ask(changes)
        missing = [tuple(path) for path in reply.body.get("missing_paths", ())]
        if reply.status == MISSING_PATHS:
            with self._lock:
                again = self._memory.again(missing)
            if again.entries:
                second = self._ask(again)
                missing = [tuple(path) for path in second.body.get("missing_paths", ())] if second.status == 1 else []
                if second.status < 0:
                    reply = second
        answer = _answer(reply, missing)
        if answer.status < OK:
            raise TreeViewerError(answer)
        return answer

    def _ask(self, changes: Changes) -> wire.Reply:
        if self._format is None:
            offered = self._exchange({}, wire.BINARY).status
            self._format = wire.JSON if offered in (UNKNOWN_FORMAT, UNKNOWN_VERSION) else wire.BINARY
        reply = self._exchange(changes.body(0), self._format)
        if reply.status in (UNKNOWN_FORMAT, UNKNOWN_VERSION) and self._format == wire.BINARY and self._wanted is None:
            self._format = wire.JSON  # another viewer has taken the place of the one that spoke it
            reply = self._exchange(changes.body(0), self._format)
        return reply

    def _exchange(self, body: dict[str, Any], name: str) -> wire.Reply:
        utime, future = self._post(body, name)
        try:
            return future.result(self.timeout)
        except TimeoutError:
            lost = "; big messages can get lost over UDP, tcpq:// loses none" if self.url.startswith("udpm") else ""
            raise TimeoutError(f"no viewer answered within {self.timeout:g} s on {self.url}{lost}") from None
        finally:
            self._waiting.pop(utime, None)

    def _post(self, body: dict[str, Any], name: str) -> tuple[int, Future[wire.Reply]]:
        with self._lock:
            utime = self._utime = max(self._utime + 1, time.time_ns() // 1000)
            future = self._waiting[utime] = Future()
        try:
            message = wire.encode({**body, "timestamp": utime}, utime, name)
            self._link.publish(f"{wire.REQUEST}_<{self.client_id}>", message)
        except BaseException:
            self._waiting.pop(utime, None)
            raise
        return utime, future

    def _answered(self, message: bytes) -> None:
        """In the link's thread."""
        reply = wire.decode(message)
        future = self._waiting.pop(reply.timestamp, None) if reply is not None else None
        if future is not None and reply is not None:
            future.set_result(reply)

    def _announced(self, message: bytes) -> None:
        """In the link's thread: a viewer has started and knows nothing; nobody waits for its answer."""
        reply = wire.decode(message)
        if reply is None or reply.body.get("ready") is not True:
            return
        with self._lock:
            everything = self._memory.all()
        if everything.entries:
            with contextlib.suppress(ConnectionError):  # gone again; it will say when it is back
                utime, _ = self._post(everything.body(0), self._format or wire.JSON)
                self._waiting.pop(utime, None)


def _shown(value: object) -> str:
    """A value in a sentence: short, whatever it is."""
    text = repr(value) if isinstance(value, (str, int, float)) else f"a {type(value).__name__}"
    return text if len(text) <= 40 else f"{text[:40]}…"


def _answer(reply: wire.Reply, missing: list[Path]) -> Answer:
    body = reply.body

    def paths(name: str) -> tuple[Path, ...]:
        return tuple(tuple(path) for path in body.get(name, ()))

    status = reply.status
    if status == MISSING_PATHS and not missing:
        status = OK
    errors: Final = body.get("errors", ())
    more = f" ({len(errors)} commands failed)" if len(errors) > 1 else ""
    return Answer(
        status,
        paths("deleted_paths"),
        paths("added_geometries"),
        paths("set_transforms"),
        tuple(missing),
        tuple(body.get("warnings", ())),
        f"{body.get('error', '')}{more}",
    )
