"""A finished request of the render endpoint, for the browser view's list of recent renders."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class RenderRecord:
    """A finished request of the render endpoint, without its scene."""

    number: int
    """Number of the request since start, from 1."""
    end_time: float
    """Time of the response, seconds since 1970."""
    status: int
    """HTTP status."""
    seconds: float
    """Time from the request's headers to the response."""
    queue_seconds: float
    """Part of ``seconds`` spent waiting for a worker thread."""
    image_text: str
    """Type and size of the image, for people."""
    scene_text: str
    """Size, generator and number of primitives of the scene, for people."""
    kind: str
    """Type of the image: ``color``, ``depth`` or ``label``; empty if the request was invalid."""
    body: bytes
    """The image as it was sent; empty if there is none, or if newer ones took its place."""
    media_type: str
    """Media type of ``body``."""
    error: str
    """The error message that was sent; empty if there is none."""
    warnings: tuple[str, ...] = ()
    """Sentences about parts of the request or the scene that were ignored or repaired."""
