"""For tests of the HTTP server."""

from __future__ import annotations

import pytest

from gateway.server.http_protocol import BoundedHttp


@pytest.fixture
def received(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Lengths of the pieces that HTTP connections have received, in order."""
    sizes: list[int] = []
    plain = BoundedHttp.data_received

    def data_received(self: BoundedHttp, data: bytes) -> None:
        plain(self, data)
        sizes.append(len(data))

    monkeypatch.setattr(BoundedHttp, "data_received", data_received)
    return sizes
