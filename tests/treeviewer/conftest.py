"""A viewer in process, and a network of a test's own."""

from __future__ import annotations

import pytest

from tests.treeviewer.conversation import Viewer
from tests.treeviewer.transports import free_url, join


@pytest.fixture
def viewer() -> Viewer:
    return Viewer()


@pytest.fixture
def url() -> str:
    """A network of this test's own, on which LCM works."""
    network = free_url()
    join(network)
    return network
