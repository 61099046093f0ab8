"""Record of a finished render request, for observers such as the browser view's list of recent renders."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.render.form import RenderRequest
from gateway.render.pipeline import EncodedImage


@dataclass(frozen=True, slots=True, eq=False)
class RenderRecord:
    """One finished request."""

    request_id: str
    status: int
    """HTTP status of the response."""
    seconds: float
    """Time from the request's headers to the response."""
    queue_seconds: float
    """Part of ``seconds`` spent waiting for a worker thread."""
    request: RenderRequest | None
    """None if the form was invalid. Holds the whole scene: do not keep a reference."""
    image: EncodedImage | None
    """The response's image; None if there is an error."""
    error: str
    """Error message of the response; empty on success."""
    outcome: str = ""
    """Label for metrics if ``status`` is ambiguous: ``slow`` for a 503 at the deadline; else empty."""
