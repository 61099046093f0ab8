"""An LCM network for each test."""

from __future__ import annotations

import pytest

from tests.treeviewer.transports import free_url, join


@pytest.fixture
def url() -> str:
    """URL of a network of this test's own, on which LCM works."""
    network = free_url()
    join(network)
    return network
