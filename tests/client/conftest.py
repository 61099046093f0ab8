"""Fixtures of the client's tests."""

import pytest


@pytest.fixture(autouse=True)
def soon_connected_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Try a lost connection again at once, not after a second."""
    monkeypatch.setattr("scenegate.lcm.tcpq_transport.RETRY_SECONDS", 0.05)
