"""503 responses for work that was not done."""

import httpx2
import pytest
from fastapi import APIRouter, FastAPI

from gateway.runtime.http.plain_error_route import PlainErrorRoute
from gateway.runtime.workers.pool_errors import DeadlineExceeded, PoolClosed, QueueFull
from renderers.compiler.pending import KernelsDelayed


@pytest.mark.parametrize(
    ("error", "retry_after", "text"),
    [
        (QueueFull("9 requests are waiting", 7), "7", "the server is busy: 9 requests are waiting; try again in 7 s"),
        (PoolClosed("the server is shutting down"), "1", "the server is shutting down"),
        (DeadlineExceeded("it took longer than 30 s"), None, "rendering was stopped: it took longer than 30 s"),
        (
            KernelsDelayed(4),
            "4",
            "kernels that this needs could not be loaded, which is tried again; the server's log has the reason",
        ),
    ],
)
async def test_the_response_says_why_and_when_to_try_again(
    error: Exception, retry_after: str | None, text: str
) -> None:
    routes = APIRouter(route_class=PlainErrorRoute)

    @routes.get("/")
    async def fail() -> None:
        raise error

    app = FastAPI()
    app.include_router(routes)
    async with httpx2.AsyncClient(transport=httpx2.ASGITransport(app), base_url="http://test") as client:
        response = await client.get("/")
    assert (response.status_code, response.text) == (503, text)
    assert response.headers.get("retry-after") == retry_after
