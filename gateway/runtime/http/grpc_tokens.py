"""Token check for gRPC calls, by their metadata; health checks need no token."""

from collections.abc import Awaitable, Callable
from typing import Any, Final

import grpc

from gateway.runtime.http.tokens import Tokens

_HEALTH: Final = "/grpc.health.v1.Health/"


class TokenCheck(grpc.aio.ServerInterceptor):  # type: ignore[misc]  # grpc has no types
    """Reject calls without ``authorization: Bearer TOKEN`` with UNAUTHENTICATED."""

    def __init__(self, tokens: Tokens) -> None:
        self._tokens = tokens

    async def intercept_service(
        self,
        continuation: Callable[[grpc.HandlerCallDetails], Awaitable[grpc.RpcMethodHandler]],
        handler_call_details: grpc.HandlerCallDetails,
    ) -> grpc.RpcMethodHandler:
        """Return the call's own handler, or one that rejects it."""
        handler = await continuation(handler_call_details)
        if handler is None or handler_call_details.method.startswith(_HEALTH):
            return handler
        for name, value in handler_call_details.invocation_metadata or ():
            if name == "authorization" and isinstance(value, str) and self._tokens.accept_header(value):
                return handler
        return _REJECTIONS[bool(handler.request_streaming), bool(handler.response_streaming)](_reject)


async def _reject(_: object, context: grpc.aio.ServicerContext[Any, Any]) -> None:
    await context.abort(grpc.StatusCode.UNAUTHENTICATED, "the metadata needs 'authorization: Bearer TOKEN'")


_REJECTIONS: Final = {
    (False, False): grpc.unary_unary_rpc_method_handler,
    (False, True): grpc.unary_stream_rpc_method_handler,
    (True, False): grpc.stream_unary_rpc_method_handler,
    (True, True): grpc.stream_stream_rpc_method_handler,
}
