"""gRPC server of the image stream, image events, health and reflection. Sends serialised bytes."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from typing import Any, TypeAlias

import grpc
import structlog
from google.protobuf.message import DecodeError, Message
from grpc_health.v1 import health, health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha import reflection

from gateway.adapters.stereo.device.camera_config import StereoConfig, Tls
from gateway.adapters.stereo.stream.faults import CUT_REASON, FaultInjector
from gateway.adapters.stereo.stream.set_kind import ImageRequestError, read_set_kind
from gateway.adapters.stereo.stream.subscriptions import EventHub, ImageSetHub, LimitError, StreamError
from gateway.runtime.http.grpc_tokens import TokenCheck
from gateway.runtime.workers import process_tuning
from scenegate.camera import image_interface_pb2 as pb
from scenegate.regular_files import read_regular

SERVICE = pb.DESCRIPTOR.services_by_name["ImageInterface"].full_name
EVENTS_SERVICE = pb.DESCRIPTOR.services_by_name["ImageEventsInterface"].full_name
MAX_CALLS = 1024
"""Maximum number of concurrent calls, health checks and reflection included; further ones get RESOURCE_EXHAUSTED."""
CLIENT_MESSAGE_LIMIT = 4 << 20
"""Default of gRPC clients for the maximum message size, bytes."""
STOP_SECONDS = 1.0
"""Maximum seconds for clients to receive the end of their streams. Only clients that do not read take that long."""
RETURN_BYTES = 64 << 20
"""Number of bytes of unsent messages after which freed memory is returned to the system."""
RETURN_SECONDS = 2.0
"""Seconds for grpc to free the messages of ended streams before their memory is returned."""
_STATUS_CODES: Mapping[type[Exception], grpc.StatusCode] = {
    ImageRequestError: grpc.StatusCode.INVALID_ARGUMENT,
    LimitError: grpc.StatusCode.RESOURCE_EXHAUSTED,
    StreamError: grpc.StatusCode.UNAVAILABLE,
}
_OPTIONS: list[tuple[str, int]] = [
    ("grpc.max_send_message_length", -1),
    ("grpc.max_receive_message_length", 64 << 10),  # requests are a few bytes
    ("grpc.so_reuseport", 0),  # a second gateway must fail, because the port is taken
    # Detect clients that disappear without closing the connection within half a minute.
    ("grpc.keepalive_time_ms", 20_000),
    ("grpc.keepalive_timeout_ms", 10_000),
    ("grpc.http2.max_ping_strikes", 0),  # no limit for the pings of clients
]

_log = structlog.get_logger("stereo")

Context: TypeAlias = "grpc.aio.ServicerContext[Any, Any]"


class UnsentMessages:
    """Returns the memory of unsent messages to the system.

    grpc copies each message for each client. Many clients that do not read hold a lot of memory at the same time. The
    allocator would keep that memory after it is freed (see ``process_tuning.tune``).
    """

    def __init__(self, return_memory: Callable[[], object] = process_tuning.return_memory) -> None:
        """``return_memory`` is called in a worker thread."""
        self._return_memory = return_memory
        self._nbytes = 0
        self._timer: asyncio.TimerHandle | None = None

    def add(self, nbytes: int) -> None:
        """Count a message of ``nbytes`` bytes whose stream ended before all of it was sent."""
        self._nbytes += nbytes
        if self._nbytes >= RETURN_BYTES and self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(RETURN_SECONDS, self._return)

    def _return(self) -> None:
        self._timer, self._nbytes = None, 0
        asyncio.get_running_loop().run_in_executor(None, self._return_memory)


class StreamServicer:
    """Methods ``StreamImageSets`` and ``StreamImageEvents``."""

    def __init__(
        self, hub: ImageSetHub, events: EventHub, injector: FaultInjector | None, config: StereoConfig
    ) -> None:
        self._hub = hub
        self._events = events
        self._injector = injector
        self._config = config
        self._unsent = UnsentMessages()

    async def stream(self, request: pb.ImageSetRequest, context: Context) -> None:
        """Send image sets until the client cancels or its deadline passes."""
        kind = read_set_kind(request, self._config)
        with self._hub.subscribe(kind) as subscription:
            logged = False
            while True:
                data = await subscription.get()
                if not logged:
                    _log_stream(context.peer(), str(kind), len(data))
                    logged = True
                try:
                    await context.write(data)
                except BaseException:
                    self._unsent.add(len(data))
                    raise
                del data  # free it before waiting for the next set
                injector = self._injector
                if injector is not None and 0 < injector.faults.disconnect_after <= subscription.sent:
                    raise StreamError(CUT_REASON)

    async def events(self, request: pb.ImageEventsRequest, context: Context) -> None:
        """Send image events until the client cancels or its deadline passes."""
        with self._events.subscribe() as queue:
            # Send headers first: a client may wait for them before it triggers a depth image.
            await context.send_initial_metadata(())
            while True:
                for event in await queue.get():
                    if request.depth_acquisition_done_enabled:
                        await context.write(event)


def _decode_requests(message: type[Message], method: Callable[[Any, Context], Awaitable[None]]) -> Any:
    """Return a handler that calls ``method`` with a decoded ``message``. Its errors become status codes."""

    async def handle(data: bytes, context: Context) -> None:
        try:
            request = message.FromString(data)
        except DecodeError:
            reason = f"the {len(data)} bytes of the request are not a message {message.DESCRIPTOR.name}"
            await context.abort(grpc.StatusCode.INVALID_ARGUMENT, reason)
        try:
            try:
                await method(request, context)
            except (ImageRequestError, LimitError, StreamError) as error:
                await context.abort(_STATUS_CODES[type(error)], str(error))
        except grpc.aio.InternalError:
            # The connection broke while a message was written. End the call as grpc does when it detects that a client
            # has disconnected; otherwise it would log a traceback.
            raise asyncio.CancelledError from None

    return handle


def _log_stream(peer: str, kind: str, set_bytes: int) -> None:
    note = {"note": "more than the default limit of gRPC clients"} if set_bytes > CLIENT_MESSAGE_LIMIT else {}
    _log.info(f"streaming {kind} to {peer}", bytes_per_set=set_bytes, **note)


@asynccontextmanager
async def serving(
    hub: ImageSetHub, events: EventHub, injector: FaultInjector | None, config: StereoConfig
) -> AsyncIterator[int]:
    """Serve while the block runs, and yield the port. The arguments are those of ``FramePublisher``.

    Raises OSError, one sentence, if the port is not available, or a certificate cannot be read.
    """
    interceptors = () if config.tokens is None else (TokenCheck(config.tokens),)
    server = grpc.aio.server(interceptors=interceptors, options=_OPTIONS, maximum_concurrent_rpcs=MAX_CALLS)
    servicer = StreamServicer(hub, events, injector, config)
    for service, name, method, message in (
        (SERVICE, "StreamImageSets", servicer.stream, pb.ImageSetRequest),
        (EVENTS_SERVICE, "StreamImageEvents", servicer.events, pb.ImageEventsRequest),
    ):
        handler = grpc.unary_stream_rpc_method_handler(_decode_requests(message, method))  # without (de)serialisers
        server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler(service, {name: handler}),))
    health_servicer = health.aio.HealthServicer()
    health_pb2_grpc.add_HealthServicer_to_server(health_servicer, server)
    services = (SERVICE, EVENTS_SERVICE, health.SERVICE_NAME, reflection.SERVICE_NAME)
    reflection.enable_server_reflection(services, server)
    address = f"[{config.host}]:{config.port}" if ":" in config.host else f"{config.host}:{config.port}"
    try:
        port = _bind(server, address, config.tls)
    except RuntimeError as error:
        await server.stop(None)
        reason = "the port is taken or not allowed; --grpc-port chooses another"
        raise OSError(f"the stereo camera cannot listen on {address}: {reason}") from error
    await server.start()
    for name in ("", SERVICE, EVENTS_SERVICE):
        await health_servicer.set(name, health_pb2.HealthCheckResponse.SERVING)

    async def stop() -> None:
        await health_servicer.enter_graceful_shutdown()
        await server.stop(STOP_SECONDS)

    try:
        yield port
    finally:
        await asyncio.shield(stop())  # also if the caller is cancelled again


def _bind(server: grpc.aio.Server, address: str, tls: Tls | None) -> int:
    if tls is None:
        return int(server.add_insecure_port(address))
    files = []
    for path in (tls.key, tls.certificate, tls.client_ca):
        try:
            files.append(read_regular(path) if path is not None else None)
        except OSError as error:
            raise OSError(f"the stereo camera cannot read {path}: {error.strerror}") from error
    key, certificate, authority = files
    credentials = grpc.ssl_server_credentials([(key, certificate)], authority, require_client_auth=bool(authority))
    return int(server.add_secure_port(address, credentials))
