"""Fixture: an unused LCM network."""

import pytest

from tests.adapters.treeviewer.transports import free_url, join


@pytest.fixture
def url() -> str:
    """URL of an unused LCM network."""
    network = free_url()
    join(network)
    return network
