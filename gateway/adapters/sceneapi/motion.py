"""The scene with its motion as glTF with an animation: ``GET /scene/motion.glb``, and for logs."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from gateway.files.gltf.export import MAX_BYTES, MotionWriter
from gateway.runtime.http.plain_error_route import PlainErrorRoute
from gateway.runtime.http.section_files import DEFAULT_RATE, Rate, Seconds, SectionFiles, section_responses
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.timeline import Timeline

MEDIA_TYPE = "model/gltf-binary"


def motion_router(tree: LiveTree, timeline: Timeline, max_bytes: int = MAX_BYTES) -> APIRouter:
    """Return the route of the recent motion."""
    router = APIRouter(tags=["The live scene"], route_class=PlainErrorRoute)
    files = SectionFiles(tree, timeline)
    responses = section_responses(
        MEDIA_TYPE, "The file. Its asset.extras.warnings has sentences about what it does not have."
    )

    @router.get("/scene/motion.glb", summary="Download the motion", response_class=Response, responses=responses)
    async def motion(request: Request, seconds: Seconds = None, rate: Rate = DEFAULT_RATE) -> Response:
        """The scene with its recent motion, as binary glTF with an animation: Y up, textures embedded."""
        return await files.response(request, MotionWriter(max_bytes), seconds, rate, MEDIA_TYPE)

    return router
