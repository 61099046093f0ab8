"""uvicorn's protocol classes are extended, and they are not a public interface: notices when they change.

On a failure read the new source beside gateway/server/http_protocol.py or websocket_protocol.py, run the tests of this
folder and tests/security, then enter the new digest.
"""

from __future__ import annotations

import hashlib
import inspect

import pytest
from uvicorn.protocols.http import flow_control, httptools_impl
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

DIGESTS = [
    (httptools_impl.HttpToolsProtocol, "18fdf324b11bf160"),
    (httptools_impl.RequestResponseCycle, "e67d470d435dcc1c"),
    (flow_control.FlowControl, "126debcdaa894c83"),
    (WebSocketsSansIOProtocol, "0bbcec98938432f7"),
]


@pytest.mark.parametrize(("extended", "digest"), DIGESTS, ids=lambda value: getattr(value, "__name__", ""))
def test_source_is_the_reviewed_one(extended: type, digest: str) -> None:
    source = inspect.getsource(extended)
    assert hashlib.sha256(source.encode()).hexdigest()[:16] == digest
