"""The token of gRPC calls, in their metadata; health checks need none."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any, Final

import grpc

from gateway.server.tokens import Tokens

_HEALTH: Final = "/grpc.health.v1.Health/"


class TokenCheck(grpc.aio.ServerInterceptor):  # type: ignore[misc]  # grpc has no types
    """UNAUTHENTICATED without ``authorization: Bearer TOKEN``."""

    def __init__(self, tokens: Tokens) -> None:
        self._tokens = tokens

    async def intercept_service(
        self,
        continuation: Callable[[grpc.HandlerCallDetails], Awaitable[grpc.RpcMethodHandler]],
        handler_call_details: grpc.HandlerCallDetails,
    ) -> grpc.RpcMethodHandler:
        """The call's own handler, or one that refuses it."""
        handler = await continuation(handler_call_details)
        if handler is None or handler_call_details.method.startswith(_HEALTH):
            return handler
        for name, value in handler_call_details.invocation_metadata or ():
            if name == "authorization" and isinstance(value, str) and self._tokens.accept_header(value):
                return handler
        return _REFUSALS[bool(handler.request_streaming), bool(handler.response_streaming)](_refuse)


async def _refuse(_: object, context: grpc.aio.ServicerContext[Any, Any]) -> None:
    await context.abort(grpc.StatusCode.UNAUTHENTICATED, "the metadata needs 'authorization: Bearer TOKEN'")


_REFUSALS: Final = {
    (False, False): grpc.unary_unary_rpc_method_handler,
    (False, True): grpc.unary_stream_rpc_method_handler,
    (True, False): grpc.stream_unary_rpc_method_handler,
    (True, True): grpc.stream_stream_rpc_method_handler,
}
