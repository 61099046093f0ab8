"""What is told to observers (the browser's panel of recent renders) about every finished request."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.render.form import RenderRequest
from gateway.render.pipeline import Picture


@dataclass(frozen=True, slots=True, eq=False)
class RenderRecord:
    """One request, answered."""

    request_id: str
    status: int
    """HTTP status of the answer."""
    seconds: float
    """From the first byte of the body to the answer."""
    queued: float
    """Seconds of it spent waiting for a thread."""
    request: RenderRequest | None
    """None: the form was not understood. Holds the whole scene: do not keep it."""
    picture: Picture | None
    """None: there is an error."""
    error: str
    """The sentence that the client got; empty: none."""
    outcome: str = ""
    """For metrics: ``slow`` where it was ended at its deadline; empty: the status tells it."""
