"""One HTTP connection: bounds on everything that comes before the application, and turning away without asking it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, cast

import httptools
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

from gateway.server.access import CORS_EXPOSED
from gateway.server.alarms import Alarm, alarms_of
from gateway.server.direct import EXTENSION, Direct
from gateway.server.joined import Joined
from gateway.server.middleware import request_id
from gateway.server.paced import LARGEST_PIECE, Paced

MAX_HEAD_BYTES: Final = 64 << 10
"""Request line and headers; Drake's client sends 200 bytes, browsers a few thousand. The parser has no bound. The same
for what stands between two chunks of a body, and behind the last."""
MAX_TARGET_BYTES: Final = 8 << 10
"""Of the request line's target: RFC 9110 wants 8000 at least, and a query of 64 kB takes 20 ms to take apart."""
MAX_PIPELINED: Final = 64
"""Requests of a connection that wait for the one before; with more the connection ends."""
PIECE_BYTES: Final = 16 << 10
"""Read at a time of heads and chunked bodies: they can hold a request in 20 bytes and a chunk in 6, and each takes the
event loop microseconds. Plain bodies come in pieces of a megabyte."""
HEAD_SECONDS: Final = 30.0
"""Time for them to arrive whole; a connection that sends nothing after connecting ends as well."""
BODY_SECONDS: Final = 90.0
"""Without a byte of a body that is not complete; what the gateway itself does not read for now does not count. The
render endpoint asks earlier, with a sentence."""
MAX_CONNECTIONS: Final = 8192
"""HTTP and WebSocket connections of one port; beyond it 503 at once. Each takes a descriptor and some 20 kB."""
LINGER_SECONDS: Final = 5.0
"""For a client that was turned away in the middle of its body to read why: what it sends is thrown away."""
LINGER_PAUSE: Final = 0.1
"""Of them without reading: a client that looks for answers while it sends has left by then, and need not send more."""
LINGER_BYTES: Final = 64 << 20
"""Thrown away of one such body; then the connection ends."""


@dataclass(frozen=True, slots=True)
class TurnedAway:
    """The answer to a request that there is no place for: 503."""

    sentence: str
    retry_after: int
    """Seconds."""


Door = Callable[[bytes, bytes], TurnedAway | None]
"""Asked with method and target of every request that has a body, when its head has arrived; must return at once."""


class BoundedHttp(HttpToolsProtocol):
    """Bounds what comes before the application, and turns away by ``app.state.door`` without asking the application.

    Headers without end are refused (431), connections whose headers never come to an end are ended. Turning away where
    the head is read costs a tenth of an answer of the application, so that those who are let in do not notice it.
    """

    _deaf = False
    """Whatever still comes is thrown away."""
    _beside_body = 0
    _lingered = 0
    _linger_timer: asyncio.TimerHandle | None = None
    _head_bytes = 0
    _in_head = True
    _encoding = b""
    """Transfer-Encoding of the request that arrives."""
    _head_timer: Alarm | asyncio.TimerHandle | None = None
    _body_timer: Alarm | asyncio.TimerHandle | None = None
    _received = 0
    _last_word: Callable[[], None] | None = None
    """What is said when the answers that are due have been given."""
    _heard_out = False
    """Whether the request that this is about has arrived whole."""
    direct: Direct | None = None
    """Of the request whose body arrives, if it says how long that is and the application is asked already ..."""
    _present: Direct | None = None
    """... and, until the next one, of the request whose body has arrived."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # uvicorn names it narrower
        """Starts the clock of the first request."""
        super().connection_made(transport)
        if len(self.connections) > MAX_CONNECTIONS:
            self._refuse(503, "Service Unavailable", f"There are {MAX_CONNECTIONS} connections already.")
            self.transport.close()
            return
        self._head_timer = alarms_of(self.loop).later(HEAD_SECONDS, self._too_late)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stops the clocks."""
        self._stop_timer()
        self._stop_body_timer()
        if self._linger_timer is not None:
            self._linger_timer.cancel()
        super().connection_lost(exc)
        if self._present is not None:
            self._present.lose()
            self._present = self.direct = None

    @property
    def pouring(self) -> bool:
        """Whether the application takes what comes where it lies."""
        return self.direct is not None and self.direct.taken and not self._deaf

    def pour(self, buffer: bytearray, count: int) -> None:
        """What came while ``pouring``: the first ``count`` bytes of ``buffer``."""
        assert self.direct is not None
        self._received += 1
        self._unset_keepalive_if_required()
        body = min(count, self.direct.left)
        self.direct.feed(buffer, body)
        if self.direct.left == 0:
            self.parser = _parser(self)  # the one before waits for the body
            self.on_message_complete()
            if body < count:
                self.data_received(bytes(buffer[body:count]))
            else:
                self._watch_rest()

    @property
    def plain(self) -> bool:
        """Whether nothing but bytes of a body can come now, none of which is looked at."""
        return self._deaf or (not self._in_head and b"chunked" not in self._encoding)

    def data_received(self, data: bytes) -> None:
        """Counts while the head is not complete; what a head shares a piece with is the body's business."""
        if self._deaf:
            self._lingered += len(data)
            if self._lingered > LINGER_BYTES:
                self.transport.close()
            return
        if not self._in_head:
            self._beside_body += len(data)
            if self._beside_body > MAX_HEAD_BYTES + len(data):
                self._refuse(431, "Request Header Fields Too Large", "What is beside the body's chunks is too long.")
                return
        self._received += 1
        if self._in_head and self._head_bytes > MAX_HEAD_BYTES:
            self._refuse(431, "Request Header Fields Too Large", f"The headers are longer than {MAX_HEAD_BYTES} bytes.")
            return
        if self._in_head:
            self._head_bytes += len(data)
        super().data_received(data)
        self._watch_rest()

    def on_message_begin(self) -> None:
        """A request starts; one on a kept connection gets a clock of its own."""
        if self._deaf:
            return
        self._encoding = b""
        super().on_message_begin()
        if self._head_timer is None:
            self._head_timer = alarms_of(self.loop).later(HEAD_SECONDS, self._too_late)

    def on_header(self, name: bytes, value: bytes) -> None:
        """A header. One behind a chunked body is none: whoever checked the head has not seen it."""
        if not self._in_head or self._deaf:
            return
        if name.lower() == b"transfer-encoding":
            self._encoding += value.lower()
        super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """The head has arrived whole."""
        self._in_head = False
        self._head_bytes = 0
        self._stop_timer()
        if self._deaf or self._turn_away():
            return
        if len(self.url) > MAX_TARGET_BYTES:
            self._refuse(414, "URI Too Long", f"The path with its query is longer than {MAX_TARGET_BYTES} bytes.")
            return
        if self.parser.should_upgrade() and self._has_body() and not self._owes:
            self._refuse(400, "Bad Request", "A request with a body cannot ask for another protocol (Upgrade) here.")
            return
        if len(self.pipeline) >= MAX_PIPELINED:
            self._deaf = True
            self.transport.abort()
            return
        super().on_headers_complete()
        self._watch_body()
        if self.cycle is not None and self.cycle.scope is self.scope:
            self.cycle.transport = cast("asyncio.Transport", Joined(self.transport, self.loop))
            if not self.pipeline and not self.parser.should_upgrade():
                self._offer()

    @property
    def _owes(self) -> bool:
        """Whether the answer to an earlier request comes first."""
        return self.cycle is not None and not self.cycle.response_complete

    def _should_upgrade(self) -> bool:
        return not self._deaf and super()._should_upgrade()

    def _length(self) -> int:
        """Of the body, as the head says it; 0 where it is in chunks."""
        return 0 if self._encoding else int(dict(self.headers).get(b"content-length", b"0"))

    def _has_body(self) -> bool:
        return bool(self._encoding) or self._length() > 0

    def _offer(self) -> None:
        """Lets the application, which has not begun, have the body directly."""
        if (length := self._length()) > 0:
            self._present = self.direct = Direct(self.loop, length, partial(self._begin_body, self.cycle))
            self.scope["extensions"] = {EXTENSION: self.direct}  # type: ignore[dict-item]  # it may hold anything

    def _begin_body(self, cycle: RequestResponseCycle) -> bytes:
        """As the request's ``receive`` would."""
        if cycle.waiting_for_100_continue and not self.transport.is_closing():
            cycle.waiting_for_100_continue = False
            self.transport.write(b"HTTP/1.1 100 Continue\r\n\r\n")
        self.flow.resume_reading()
        come, cycle.body = bytes(cycle.body), bytearray()
        return come

    def on_body(self, body: bytes) -> None:
        """What belongs to a request that was turned away is nobody's."""
        self._beside_body = 0
        if self.direct is not None:
            self.direct.left -= len(body)
        if not self._deaf:
            super().on_body(body)

    def on_message_complete(self) -> None:
        """The next thing on this connection is a head again."""
        self._beside_body = 0
        if self._deaf:
            if self._last_word is not None:
                self._heard_out = True
            elif not self.parser.should_upgrade():  # else the parser has left the body to others
                self.transport.close()  # nothing is unread, so the answer arrives
            return
        self._in_head = True
        self.direct = None
        self._stop_body_timer()
        super().on_message_complete()

    def _turn_away(self) -> bool:
        """Whether the door is shut for the request whose head has arrived; then it has been told so."""
        if self._owes:
            return False  # the application refuses this one in its turn
        door: Door | None = getattr(self.config.app.state, "door", None)  # type: ignore[union-attr]  # a FastAPI
        if door is None or (turned_away := door(self.parser.get_method(), self.url)) is None:
            return False
        headers = f"retry-after: {turned_away.retry_after}\r\n".encode() + self._as_the_application_would()
        self._refuse(503, "Service Unavailable", turned_away.sentence, headers)
        return True

    def _as_the_application_would(self) -> bytes:
        """The request's id; what lets a page of an allowed origin read the answer: else it sees a broken network."""
        sent = {name: value for name, value in self.headers if name in (b"x-request-id", b"origin")}
        lines = b"x-request-id: %s\r\n" % request_id(sent.get(b"x-request-id", b"")).encode()
        readers: Collection[str] = getattr(self.config.app.state, "cors_origins", ())  # type: ignore[union-attr]  # a FastAPI
        if not readers or b"origin" not in sent:
            return lines
        origin = "*" if "*" in readers else sent[b"origin"].decode("latin-1")
        if origin not in readers:
            return lines
        names = ", ".join(CORS_EXPOSED)
        lines += f"access-control-allow-origin: {origin}\r\naccess-control-expose-headers: {names}\r\n".encode()
        return lines if origin == "*" else lines + b"vary: Origin\r\n"

    def send_400_response(self, msg: str) -> None:
        """What the answers before have to say comes first."""
        if self._deaf:
            return  # one word was the last already
        if self._comes_later(partial(self.send_400_response, msg)):
            return
        self._flush()
        super().send_400_response(msg)

    def on_response_complete(self) -> None:
        """Whose turn was waited for may be refused now."""
        super().on_response_complete()
        if self._last_word is not None and not self.pipeline and not self._owes:
            word, self._last_word = self._last_word, None
            self._deaf = False
            if not self.transport.is_closing():
                word()
                if self._heard_out:
                    self.transport.close()

    def _comes_later(self, word: Callable[[], None]) -> bool:
        """Whether answers to earlier requests are due; then ``word`` is said behind them."""
        if not self._in_head and self.cycle is not None and self.cycle.scope is self.scope:
            if not self.pipeline or self.pipeline[0][0] is not self.cycle:
                return False  # the application answers the very request that this is about
            self.pipeline.popleft()  # the application is not asked at all
            self.cycle = self.pipeline[0][0] if self.pipeline else None  # type: ignore[assignment]  # as in the beginning
        elif not self._owes:
            return False
        self._deaf = True
        self._last_word = word
        self._stop_timer()
        self._stop_body_timer()
        self.flow.pause_reading()
        return True

    def shutdown(self) -> None:
        """The same for an answer without a body."""
        self._flush()
        if self._last_word is None:  # else it ends anyway, when that is said
            super().shutdown()

    def _flush(self) -> None:
        answers: object = None if self.cycle is None else self.cycle.transport
        if isinstance(answers, Joined):
            answers.flush()

    def _watch_rest(self) -> None:
        """Any byte stops uvicorn's clock of connections that are kept, and only an answer starts it: it starts again
        after the rest of a body that was answered early, and after a line between two requests."""
        if (
            self._in_head
            and self._head_timer is None
            and self.timeout_keep_alive_task is None
            and self.cycle is not None
            and self.cycle.response_complete
            and not self.pipeline
            and self in self.connections  # else another protocol has the transport, or nobody
            and not self.transport.is_closing()
        ):
            self.timeout_keep_alive_task = self.loop.call_later(
                self.timeout_keep_alive, self.timeout_keep_alive_handler
            )

    def _linger(self) -> None:
        self._linger_timer = self.loop.call_later(LINGER_SECONDS, self.transport.close)
        self.flow.resume_reading()

    def _stop_timer(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None

    def _watch_body(self) -> None:
        self._stop_body_timer()
        self._body_timer = alarms_of(self.loop).later(BODY_SECONDS, self._look_at_body, self._received)

    def _look_at_body(self, received: int) -> None:
        self._body_timer = None
        if self._received == received and not self.flow.read_paused:
            self._too_late()
        else:
            self._watch_body()

    def _stop_body_timer(self) -> None:
        if self._body_timer is not None:
            self._body_timer.cancel()
            self._body_timer = None

    def _too_late(self) -> None:
        self._head_timer = None
        if not self.transport.is_closing():
            self.transport.close()

    def _refuse(self, status: int, phrase: str, sentence: str, headers: bytes = b"") -> None:
        """Answers, throws away what still comes for a while, and ends the connection; behind answers that are due."""
        if self._comes_later(partial(self._refuse, status, phrase, sentence, headers)):
            return
        self._deaf = True
        self._unset_keepalive_if_required()
        if self.transport.is_closing():
            return
        if self.cycle is not None and not self.cycle.response_complete:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
            if self.cycle.response_started:
                self.transport.abort()  # it would stand in the answer
                return
        self._flush()
        body = (sentence + "\n").encode()
        head = f"HTTP/1.1 {status} {phrase}\r\ncontent-type: text/plain; charset=utf-8\r\nconnection: close\r\n"
        self.transport.write(head.encode() + headers + b"content-length: %d\r\n\r\n" % len(body) + body)
        # Closing now would have the system answer what is still coming with a reset, which can overtake the sentence.
        self._linger_timer = self.loop.call_later(LINGER_PAUSE, self._linger)
        self.flow.pause_reading()


class PacedHttp(Paced[BoundedHttp]):
    """Plain bodies come in large pieces, all else in small ones."""

    def __init__(self, **given: Any) -> None:
        super().__init__(BoundedHttp(**given))

    def piece(self) -> int:
        """The largest one while nothing of it is looked at."""
        return LARGEST_PIECE if self.inner.plain else PIECE_BYTES

    def may_read(self) -> bool:
        """Whether the request is not held back."""
        return not self.inner.flow.read_paused

    def take(self, buffer: bytearray, count: int) -> None:
        """What has come is copied unless the application takes it where it lies."""
        if self.inner.pouring:
            self.inner.pour(buffer, count)
        else:
            super().take(buffer, count)


def _parser(connection: HttpToolsProtocol) -> httptools.HttpRequestParser:
    """As uvicorn makes it."""
    parser = httptools.HttpRequestParser(connection)
    parser.set_dangerous_leniencies(lenient_data_after_close=True)
    return parser
