"""Deforms vertices by morph targets and skins, as the nodes of a document pose them."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.files.gltf.accessors import Accessor, Accessors
from gateway.files.gltf.gltf_errors import GltfError, as_warning
from gateway.files.gltf.schema import GltfPrimitive
from gateway.files.gltf.vertex_attributes import Floats
from renderers.stop import check_stop


@dataclass(frozen=True, slots=True, eq=False)
class MeshPose:
    """The pose of a deformable mesh and the colour of an instance, which the node gives it."""

    morph_weights: tuple[float, ...] = ()
    """Factor of each morph target."""
    joint_matrices: NDArray[np.float32] | None = None
    """(number of joints, 3, 4): from the mesh's frame in the bind pose to the frame of the deformed mesh. None: the
    mesh has no skin."""
    color: tuple[float, ...] | None = None
    """Linear RGBA factor of an instance's base colours; None: white."""


SKIN_ATTRIBUTES: Final = ("JOINTS_", "WEIGHTS_")
"""Prefixes of the names of the attributes that bind vertices to joints."""
_MAX_INFLUENCES: Final = 4
"""Maximum number of pairs ``JOINTS_n`` and ``WEIGHTS_n``; exporters write one or two."""
_VERTICES_PER_STOP_CHECK: Final = 1 << 14
REST: Final = MeshPose()
"""The pose in which meshes are drawn as they are stored."""


class Deformation(msgspec.Struct, frozen=True, gc=False, eq=False):
    """The deformation of one primitive."""

    targets: list[tuple[float, dict[str, Accessor]]]
    """Morph targets with a weight other than zero: the weight, and the differences by attribute."""
    influences: list[tuple[Accessor, Accessor]]
    """``JOINTS_n`` and ``WEIGHTS_n``: each vertex follows four joints per pair. With a skin and no pair, all vertices
    follow the first joint."""
    joint_matrices: NDArray[np.float32] | None
    """Matrices of the joints, the same as in ``MeshPose``; None without a skin."""

    @property
    def key(self) -> bytes:
        """Digest of the deformation's content, 32 bytes."""
        sha256 = hashlib.sha256()
        for weight, target in self.targets:
            sha256.update(repr((weight, [(name, accessor.key) for name, accessor in target.items()])).encode())
        for joints, weights in self.influences:
            sha256.update(repr((joints.key, weights.key)).encode())
        if self.joint_matrices is not None:
            sha256.update(self.joint_matrices.tobytes())
        return sha256.digest()

    def apply(self, attributes: dict[str, Floats], begin: int, name: str, warnings: list[str]) -> None:
        """Deform the attributes of vertices from ``begin`` on in place, morph targets first. Raises GltfError."""
        end = begin + len(attributes["POSITION"])
        with np.errstate(all="ignore"):  # meshes leave out vertices that are not finite
            for weight, target in self.targets:
                for attribute, accessor in target.items():
                    check_stop()
                    values = attributes[attribute]
                    values[:, : accessor.components] += np.float32(weight) * accessor.floats(begin, end)
        if self.joint_matrices is None:
            return
        no_joints, no_weights = np.zeros((end - begin, 1), np.uint16), np.zeros((end - begin, 1), np.float32)
        joints = np.hstack([accessor.values(begin, end) for accessor, _ in self.influences] or [no_joints])
        weights = np.hstack([accessor.floats(begin, end) for _, accessor in self.influences] or [no_weights])
        joint_count = len(self.joint_matrices)
        if joints.size and (largest := int(joints.max())) >= joint_count:
            raise GltfError(f"{name}: a vertex follows joint {largest} of a skin with {joint_count} joints")
        with np.errstate(all="ignore"):
            unbound = _skin(attributes, joints, weights, self.joint_matrices)
        if unbound and self.influences:
            warnings.append(
                f"{name}: {unbound} of {len(weights)} vertices have no weights, they follow their first joint"
            )


def _skin(
    attributes: dict[str, Floats], joints: NDArray[Any], weights: Floats, joint_matrices: NDArray[np.float32]
) -> int:
    """Multiply each vertex, in place, by the weighted mean of its joints' matrices (linear blend skinning).

    Directions are multiplied by the linear part of the mean, which is exact unless a joint scales its axes differently;
    their lengths may change. ``joints``, (N, K), are indices of ``joint_matrices``, (J, 3, 4). Returns the number of
    vertices without weights, which follow their first joint.
    """
    only_first = np.arange(weights.shape[1]) == 0
    unbound = 0
    for begin in range(0, len(weights), _VERTICES_PER_STOP_CHECK):
        check_stop()
        block = slice(begin, begin + _VERTICES_PER_STOP_CHECK)
        totals = np.cumsum(weights[block], axis=1)[:, -1:]  # a sum's order would depend on NumPy and CPU
        is_bound = (totals > 0.0) & (totals < np.inf)
        unbound += len(is_bound) - int(np.count_nonzero(is_bound))
        shares = np.where(is_bound, weights[block] / totals, only_first).astype(np.float32)
        mean = np.zeros((len(shares), 3, 4), np.float32)
        for share, joint in zip(shares.T[..., None, None], joints[block].T, strict=True):
            mean += np.where(share != 0.0, share * joint_matrices[joint], 0.0)
        for name in ("POSITION", "NORMAL", "TANGENT"):
            if name in attributes:
                vectors = attributes[name][block]
                x, y, z = vectors[:, :3].T[..., None]
                vectors[:, :3] = mean[:, :, 0] * x + mean[:, :, 1] * y + mean[:, :, 2] * z
                if name == "POSITION":
                    vectors[:, :3] += mean[:, :, 3]
    return unbound


def deformation_of(
    primitive: GltfPrimitive,
    pose: MeshPose,
    attributes: dict[str, Accessor],
    accessors: Accessors,
    name: str,
    warnings: list[str],
) -> Deformation | None:
    """Return the deformation of a primitive in a pose; None if the primitive is drawn as it is stored.

    Accessors are by attribute name, JOINTS_n and WEIGHTS_n among them. Raises GltfError if one of joints has the wrong
    type, or a vertex has more than ``4 * _MAX_INFLUENCES`` joints.
    """
    count = attributes["POSITION"].count
    targets: list[tuple[float, dict[str, Accessor]]] = []
    for k, (weight, target) in enumerate(zip(pose.morph_weights, primitive.targets or (), strict=False)):
        if weight == 0.0:
            continue
        differences = {}
        for attribute, index in (target or {}).items():
            if index is None or attribute not in attributes or attribute.startswith(SKIN_ATTRIBUTES):
                continue
            path = f"{name}.targets[{k}].{attribute}"
            # The differences of tangents have no handedness.
            components = 3 if attribute == "TANGENT" else attributes[attribute].components
            with as_warning(warnings, f"{path} is ignored"):
                accessor = accessors.get(index, path)
                if accessor.components != components or accessor.count < count:
                    found = f"{accessor.count} values of {accessor.components} components"
                    raise GltfError(f"{path}: {accessor.name} has {found}, not {count} of {components}")
                differences[attribute] = accessor
        targets.append((weight, differences))
    influences = [] if pose.joint_matrices is None else list(_influences(attributes, name))
    if not targets and pose.joint_matrices is None:
        return None
    return Deformation(targets, influences, pose.joint_matrices)


def _influences(attributes: dict[str, Accessor], name: str) -> Iterator[tuple[Accessor, Accessor]]:
    """Yield the pairs ``JOINTS_n`` and ``WEIGHTS_n`` of a primitive."""
    for n in range(_MAX_INFLUENCES + 1):
        joints, weights = attributes.get(f"JOINTS_{n}"), attributes.get(f"WEIGHTS_{n}")
        if joints is None or weights is None:
            return
        if n == _MAX_INFLUENCES:
            raise GltfError(f"{name}.attributes.JOINTS_{n}: more than {4 * n} joints per vertex are not supported")
        if joints.dtype not in (np.uint8, np.uint16):
            raise GltfError(
                f"{name}.attributes.JOINTS_{n}: {joints.name} does not have unsigned integers of 8 or 16 bits"
            )
        yield joints, weights
