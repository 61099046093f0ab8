"""What a client asked for, as a value: clients with equal ones share the rendered frames and their bytes."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.generated import image_interface_pb2 as pb
from renderers.stereo.mesh import MeshOptions

MIN_POINTS = 1000
"""The protocol document: "minimum is 1000"."""


class RequestError(ValueError):
    """The request cannot be served; the message says why."""


@dataclass(frozen=True, slots=True)
class Kind:
    """The contents of an image set."""

    left: bool = False
    right: bool = False
    disparity: bool = False
    error: bool = False
    confidence: bool = False
    mesh: MeshOptions | None = None
    color: bool = False

    @property
    def depth(self) -> bool:
        """Whether it needs a depth image: such sets come at the rate of depth images."""
        return self.disparity or self.error or self.confidence or self.mesh is not None

    @property
    def empty(self) -> bool:
        """Whether it holds nothing but a timestamp."""
        return not (self.left or self.right or self.depth)

    def __str__(self) -> str:
        names = [n for n in ("left", "right", "disparity", "error", "confidence") if getattr(self, n)]
        if self.mesh is not None:
            names.append(f"mesh({self.mesh.max_points or 'all'} points)")
        return "+".join(names) + (" rgb8" if self.color and (self.left or self.right) else "") or "timestamps only"


def kind_of(request: pb.ImageSetRequest, *, mesh_rgb: bool = False) -> Kind:
    """Reads a request.

    Args:
        request: as it came; options of a mesh that is not enabled are ignored.
        mesh_rgb: see ``StereoConfig.mesh_rgb``.

    Raises:
        RequestError: mesh options cannot be met.
    """
    mesh = None
    if request.mesh_enabled:
        options = request.mesh_options
        if 0 < options.max_points < MIN_POINTS:
            raise RequestError(
                f"mesh_options.max_points is {options.max_points}; the minimum is {MIN_POINTS}, zero means no limit"
            )
        if options.binning_method not in pb.MeshOptions.BinningMethod.values():
            raise RequestError(
                f"mesh_options.binning_method is {options.binning_method}; there are 0 (AVERAGE) and 1 (MIN_DEPTH)"
            )
        mesh = MeshOptions(
            max_points=options.max_points,
            min_depth=options.binning_method == pb.MeshOptions.MIN_DEPTH,
            watertight=options.watertight,
            textured=options.textured,
            rgb=mesh_rgb and options.textured,
        )
    images = request.left_enabled or request.right_enabled or (mesh is not None and mesh.textured)
    return Kind(
        left=request.left_enabled,
        right=request.right_enabled,
        disparity=request.disparity_enabled,
        error=request.disparity_error_enabled,
        confidence=request.confidence_enabled,
        mesh=mesh,
        color=request.color and images,
    )
