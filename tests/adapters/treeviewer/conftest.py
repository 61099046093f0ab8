"""Fixtures: a viewer in this process, and an unused LCM network."""

import pytest

from tests.adapters.treeviewer.conversation import Viewer
from tests.adapters.treeviewer.transports import free_url, join


@pytest.fixture
def viewer() -> Viewer:
    return Viewer()


@pytest.fixture
def url() -> str:
    network = free_url()
    join(network)
    return network
