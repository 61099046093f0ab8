"""Clients that vanish while a message is on its way: the call ends as a cancelled one, and nothing is logged."""

from __future__ import annotations

import asyncio
from typing import Any

import grpc
import pytest

from gateway.generated import image_interface_pb2 as pb
from gateway.stereo.server import _decoded


async def test_a_connection_that_breaks_while_writing_ends_the_call_like_a_cancellation() -> None:
    async def answer(request: pb.ImageSetRequest, context: Any) -> None:
        assert request.left_enabled
        raise grpc.aio.InternalError('Failed "execute_batch"')

    with pytest.raises(asyncio.CancelledError):
        await _decoded(pb.ImageSetRequest, answer)(b"\x08\x01", None)
