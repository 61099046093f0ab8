import pytest

from tests.conftest import DemoGateway


@pytest.fixture(scope="session")
def gateway_url(demo_gateway: DemoGateway) -> str:
    """Return the URL of a gateway whose log must have no error, whatever is done to it."""
    return demo_gateway.url
