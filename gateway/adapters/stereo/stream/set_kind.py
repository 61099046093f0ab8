"""Kind of an image set: a client's request as a value. Clients with equal requests get the same serialised bytes."""

from dataclasses import dataclass
from functools import cached_property

from gateway.adapters.stereo.device.camera_config import StereoConfig
from renderers.stereo.mesh.disparity_mesh import MeshOptions
from scenegate.camera import image_interface_pb2 as pb

MIN_POINTS = 1000
"""Minimum of ``max_points``, unless it is 0 for no limit (protocol document)."""


class ImageRequestError(ValueError):
    """The request cannot be served; the message is the reason."""


@dataclass(frozen=True)
class SetKind:
    """Contents of an image set."""

    left: bool = False
    right: bool = False
    disparity: bool = False
    error: bool = False
    confidence: bool = False
    mesh: MeshOptions | None = None
    color: bool = False
    """Left and right in RGB."""
    color_camera: bool = False
    """Image of the colour camera."""
    depth_mm: bool = False
    """Depth in millimetres."""
    aligned: bool = False
    """``depth_mm`` as seen by the colour camera."""

    @cached_property
    def needs_left(self) -> bool:
        """True if the set needs the left image: as an image, or as the colours of a mesh."""
        return self.left or (self.mesh is not None and self.mesh.textured)

    @cached_property
    def has_depth(self) -> bool:
        """True if the set needs a depth image. Such sets are sent at the rate of depth images."""
        return self.disparity or self.error or self.confidence or self.mesh is not None or self.depth_mm

    @cached_property
    def empty(self) -> bool:
        """True if the set holds a timestamp only."""
        return not (self.left or self.right or self.color_camera or self.has_depth)

    @cached_property
    def title(self) -> str:
        """Contents of the set, for logs and people."""
        names = [name for name in ("left", "right", "disparity", "error", "confidence") if getattr(self, name)]
        if self.color_camera:
            names.append("color camera")
        if self.depth_mm:
            names.append("aligned depth" if self.aligned else "depth")
        if self.mesh is not None:
            names.append(f"mesh({self.mesh.max_points or 'all'} points)")
        return "+".join(names) + (" rgb8" if self.color and (self.left or self.right) else "") or "timestamps only"

    def __str__(self) -> str:
        return self.title


def read_set_kind(request: pb.ImageSetRequest, config: StereoConfig) -> SetKind:
    """Return the kind of a request. Mesh options without a mesh are ignored; so is ``color`` on a monochrome camera.

    Raises ImageRequestError for invalid mesh options, or if the camera has no colour.
    """
    has_color_camera = config.color_camera is not None
    if request.color_camera_enabled and not (config.color or has_color_camera):
        raise ImageRequestError(f"color_camera_enabled: the {config.model.name} is monochrome")
    mesh = None
    if request.mesh_enabled:
        options = request.mesh_options
        if 0 < options.max_points < MIN_POINTS:
            raise ImageRequestError(
                f"mesh_options.max_points is {options.max_points}; the minimum is {MIN_POINTS}, zero means no limit"
            )
        if options.binning_method not in pb.MeshOptions.BinningMethod.values():
            raise ImageRequestError(
                f"mesh_options.binning_method is {options.binning_method}; there are 0 (AVERAGE) and 1 (MIN_DEPTH)"
            )
        mesh = MeshOptions(
            max_points=options.max_points,
            min_depth=options.binning_method == pb.MeshOptions.MIN_DEPTH,
            watertight=options.watertight,
            textured=options.textured,
        )
    images = request.left_enabled or request.right_enabled or (mesh is not None and mesh.textured)
    return SetKind(
        left=request.left_enabled,
        right=request.right_enabled,
        disparity=request.disparity_enabled,
        error=request.disparity_error_enabled,
        confidence=request.confidence_enabled,
        mesh=mesh,
        color=request.color and images and config.color,
        color_camera=request.color_camera_enabled,
        depth_mm=request.depth_mm_enabled,
        aligned=request.depth_mm_enabled and request.depth_aligned and has_color_camera,
    )
