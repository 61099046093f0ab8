"""For tests of the HTTP server."""

import pytest

from gateway.runtime.http.http_protocol import BoundedHttpProtocol


@pytest.fixture
def received(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Lengths of the slices that HTTP connections have handled, in order."""
    sizes: list[int] = []
    original = BoundedHttpProtocol.slice_received

    def slice_received(self: BoundedHttpProtocol, data: bytes) -> None:
        original(self, data)
        sizes.append(len(data))

    monkeypatch.setattr(BoundedHttpProtocol, "slice_received", slice_received)
    return sizes
