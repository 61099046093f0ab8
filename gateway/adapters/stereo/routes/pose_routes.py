"""``/cameras/NAME/pose``: the place of a camera as the text of ``--stereo-pose``, read and changed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final

from fastapi import APIRouter, Path, Query

from gateway.adapters.stereo.imaging.scene_view import SceneView
from gateway.adapters.stereo.routes.rest_common import RestError, error_responses, new_router
from gateway.runtime.http.openapi import example, json_example
from gateway.scene.draw.cameras import LOOK_AT_PATTERN, CameraError
from gateway.scene.draw.mount import mount_pose_text, parse_mount_pose

_EXAMPLE: Final = "eye=1.4,-1.1,1.7;target=0,0,0.85;up=0,0,1"
_RESPONSES: Final = json_example({"pose": _EXAMPLE}) | error_responses({404: "There is no such camera."})


def pose_router(views: Mapping[str, SceneView]) -> APIRouter:
    """Return the routes. ``views``: views of all cameras by name, in the order of their pipelines."""
    routes = new_router()
    names = [*views, *map(str, range(len(views)))]
    camera_name = Path(
        description="Name of the camera, or number of its pipeline",
        json_schema_extra={"enum": names},
        openapi_examples=example(names[0]),
    )

    def find(name: str) -> SceneView:
        if name not in names:
            raise RestError(404, f"there is no camera {name[:80]!r}; there are {', '.join(views)}")
        return views[name] if name in views else list(views.values())[int(name)]

    def text_of(view: SceneView) -> dict[str, str]:
        return {"pose": mount_pose_text(view.pose_in(view.tree.snapshot))}

    @routes.get("/cameras/{name}/pose", summary="Where a camera is", responses=_RESPONSES)
    async def get_pose(name: str = camera_name) -> dict[str, str]:
        """The left optical frame in the world, as text for `--stereo-pose`."""
        return text_of(find(name))

    @routes.put(
        "/cameras/{name}/pose",
        summary="Place a camera",
        responses=_RESPONSES
        | error_responses({400: "The text is not a pose.", 409: "The camera follows a node of the scene."}),
    )
    async def put_pose(
        pose: Annotated[
            str,
            Query(
                description="x,y,z,qw,qx,qy,qz or eye=x,y,z;target=x,y,z;up=x,y,z, as --stereo-pose.",
                json_schema_extra={"pattern": LOOK_AT_PATTERN},
                openapi_examples=example(_EXAMPLE),
            ),
        ],
        name: str = camera_name,
    ) -> dict[str, str]:
        """Move the camera until the gateway ends; the next images are from there."""
        view = find(name)
        try:
            X_world_left = parse_mount_pose(pose)
        except CameraError as error:
            raise RestError(400, str(error)) from None
        try:
            view.place(X_world_left)
        except CameraError as error:
            raise RestError(409, str(error)) from None
        return text_of(view)

    return routes
