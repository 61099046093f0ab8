"""The gRPC server: image sets, health, reflection; bytes go out as they are."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, TypeAlias

import grpc
import structlog
from google.protobuf.message import DecodeError, Message
from grpc_health.v1 import health, health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha import reflection

from gateway.generated import image_interface_pb2 as pb
from gateway.runtime import process_tuning
from gateway.server.grpc_tokens import TokenCheck
from gateway.stereo.config import StereoConfig, Tls
from gateway.stereo.events import EventHub
from gateway.stereo.faults import CUT, FaultInjector
from gateway.stereo.hub import FullError, Hub, StreamError
from gateway.stereo.reflection import MethodPool
from gateway.stereo.request import RequestError, kind_of

SERVICE = pb.DESCRIPTOR.services_by_name["ImageInterface"].full_name
METHOD = "StreamImageSets"
EVENTS_SERVICE = pb.DESCRIPTOR.services_by_name["ImageEventsInterface"].full_name
EVENTS_METHOD = "StreamImageEvents"
MAX_CALLS = 1024
"""At a time, health checks and reflection included; further ones get RESOURCE_EXHAUSTED at once."""
DEFAULT_LIMIT = 4 << 20
"""Bytes that a gRPC client accepts unless it was told otherwise."""
STOP_SECONDS = 1.0
"""Time for the ends of the streams to be told; only a client that does not read needs it."""
RETURN_BYTES = 64 << 20
"""Bytes of unsent messages after which freed memory is returned to the system."""
RETURN_SECONDS = 2.0
"""Time for grpc to free the messages of streams that have ended, before their memory is returned."""
_OPTIONS: list[tuple[str, int]] = [
    ("grpc.max_send_message_length", -1),
    ("grpc.max_receive_message_length", 64 << 10),  # requests are a few bytes
    ("grpc.so_reuseport", 0),  # a second gateway must hear that the port is taken
    # A client that vanished without closing its connection is noticed, and its mailbox freed, within half a minute.
    ("grpc.keepalive_time_ms", 20_000),
    ("grpc.keepalive_timeout_ms", 10_000),
    ("grpc.http2.max_ping_strikes", 0),  # clients may ask for signs of life as often as they like
]

_log = structlog.get_logger("stereo")


Context: TypeAlias = "grpc.aio.ServicerContext[Any, Any]"


class UnsentMessages:
    """Returns the memory of messages that clients have left unsent.

    grpc copies a message for every client. The copies of clients that do not read are all there at the same time, and
    when they are freed the allocator would keep their memory: no other work needs so much (see ``process.tune``).
    """

    def __init__(self, return_memory: Callable[[], object] = process_tuning.return_memory) -> None:
        """``return_memory``: called in a thread."""
        self._return_memory = return_memory
        self._nbytes = 0
        self._timer: asyncio.TimerHandle | None = None

    def add(self, nbytes: int) -> None:
        """A stream has ended while a message of so many bytes was being written."""
        self._nbytes += nbytes
        if self._nbytes >= RETURN_BYTES and self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(RETURN_SECONDS, self._return)

    def _return(self) -> None:
        self._timer, self._nbytes = None, 0
        asyncio.get_running_loop().run_in_executor(None, self._return_memory)


class StreamServicer:
    """Answers ``StreamImageSets`` and ``StreamImageEvents``."""

    def __init__(self, hub: Hub, events: EventHub, injector: FaultInjector, config: StereoConfig) -> None:
        self._hub = hub
        self._events = events
        self._injector = injector
        self._config = config
        self._unsent = UnsentMessages()

    async def stream(self, request: pb.ImageSetRequest, context: Context) -> None:
        """Sends sets until the client leaves or its deadline ends."""
        try:
            kind = kind_of(request, mesh_rgb=self._config.mesh_rgb)
        except RequestError as error:
            await context.abort(grpc.StatusCode.INVALID_ARGUMENT, str(error))
        try:
            with self._hub.subscribe(kind) as subscription:
                first = True
                while True:
                    data = await subscription.get()
                    if first:
                        _announce(context.peer(), str(kind), len(data))
                        first = False
                    try:
                        await context.write(data)
                    except BaseException:
                        self._unsent.add(len(data))
                        raise
                    del data  # while waiting for the next one
                    if 0 < self._injector.faults.disconnect_after <= subscription.sent:
                        raise StreamError(CUT)
        except FullError as error:
            await context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, str(error))
        except StreamError as error:
            await context.abort(grpc.StatusCode.UNAVAILABLE, str(error))

    async def events(self, request: pb.ImageEventsRequest, context: Context) -> None:
        """Sends events until the client leaves or its deadline ends."""
        try:
            with self._events.subscribe(depth_acquisition_done=request.depth_acquisition_done_enabled) as queue:
                # Headers first: a client may wait for them before it triggers what the events are about.
                await context.send_initial_metadata(())
                while True:
                    await context.write(await queue.get())
        except FullError as error:
            await context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, str(error))


def _decoded(kind: type[Message], answer: Callable[[Any, Context], Awaitable[None]]) -> Any:
    """``answer`` for the bytes of a request; what cannot be decoded is the client's fault and told so."""

    async def decode(data: bytes, context: Context) -> None:
        try:
            request = kind.FromString(data)
        except DecodeError:
            reason = f"the {len(data)} bytes of the request are not a message {kind.DESCRIPTOR.name}"
            await context.abort(grpc.StatusCode.INVALID_ARGUMENT, reason)
        try:
            await answer(request, context)
        except grpc.aio.InternalError:
            # The connection broke while a message was being written. grpc would log a traceback for whoever vanishes;
            # this is how it ends calls whose clients it has seen leaving.
            raise asyncio.CancelledError from None

    return decode


def _announce(peer: str, kind: str, size: int) -> None:
    note = "more than a gRPC client accepts unless told otherwise" if size > DEFAULT_LIMIT else None
    _log.info(f"streaming {kind} to {peer}", bytes_per_set=size, **({"note": note} if note else {}))


async def start(
    hub: Hub, events: EventHub, injector: FaultInjector, config: StereoConfig
) -> tuple[grpc.aio.Server, int, Callable[[], Any]]:
    """Starts serving.

    Returns:
        The server, its port, and a function to be awaited before it is stopped, which tells the health service.

    Raises:
        OSError: the port cannot be used, or a certificate cannot be read; one sentence.
    """
    checks = () if config.tokens is None else (TokenCheck(config.tokens),)
    server = grpc.aio.server(interceptors=checks, options=_OPTIONS, maximum_concurrent_rpcs=MAX_CALLS)
    servicer = StreamServicer(hub, events, injector, config)
    for service, method, answer, request in (
        (SERVICE, METHOD, servicer.stream, pb.ImageSetRequest),
        (EVENTS_SERVICE, EVENTS_METHOD, servicer.events, pb.ImageEventsRequest),
    ):
        handler = grpc.unary_stream_rpc_method_handler(_decoded(request, answer))  # bytes in and out
        server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler(service, {method: handler}),))
    healthy = health.aio.HealthServicer()
    health_pb2_grpc.add_HealthServicer_to_server(healthy, server)
    names = (SERVICE, EVENTS_SERVICE, health.SERVICE_NAME, reflection.SERVICE_NAME)
    reflection.enable_server_reflection(names, server, pool=MethodPool())
    address = f"[{config.host}]:{config.port}" if ":" in config.host else f"{config.host}:{config.port}"
    try:
        port = _bind(server, address, config.tls)
    except RuntimeError as error:
        await server.stop(None)
        raise OSError(f"the stereo camera cannot listen on {address}: the port is taken or not allowed") from error
    await server.start()
    for name in ("", *names[:2]):
        await healthy.set(name, health_pb2.HealthCheckResponse.SERVING)
    return server, port, healthy.enter_graceful_shutdown


def _bind(server: grpc.aio.Server, address: str, tls: Tls | None) -> int:
    if tls is None:
        return int(server.add_insecure_port(address))
    files = []
    for path in (tls.key, tls.certificate, tls.client_ca):
        try:
            files.append(path.read_bytes() if path is not None else None)
        except OSError as error:
            raise OSError(f"the stereo camera cannot read {path}: {error.strerror}") from error
    key, certificate, authority = files
    credentials = grpc.ssl_server_credentials([(key, certificate)], authority, require_client_auth=bool(authority))
    return int(server.add_secure_port(address, credentials))


async def stop(server: grpc.aio.Server, leave: Callable[[], Any]) -> None:
    """Ends all streams and closes the port."""
    await asyncio.shield(_stop(server, leave))


async def _stop(server: grpc.aio.Server, leave: Callable[[], Any]) -> None:
    await leave()
    await server.stop(STOP_SECONDS)
