"""Converts the geometry of a compiled MuJoCo model to parts of the scene."""

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.files.robots.cube_maps import cube_mapped
from gateway.files.robots.mjcf_materials import MjcfMaterials
from gateway.scene.draw.equal_rows import first_of_equal
from gateway.scene.draw.image_meshes import heightmap_mesh, rectangle
from gateway.scene.tree.geometry import Part, Shape, Surface
from gateway.scene.tree.transforms import from_pose
from renderers import primitives
from renderers.drawlist import Mesh
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere
from scenegate.robots.robot import GeometryUse
from scenegate.robots.robot_errors import check_count
from scenegate.robots.textured_box import textured_box

COLLISION_GROUP: Final = 3
"""First group of collision geometry, by convention: MuJoCo's viewer hides this group and higher ones."""
INFINITE_PLANE_HALF_SIDE: Final = 10.0
"""Half the side length with which infinite planes are drawn, metres."""
_BOX_FACES: Final = np.array(
    [
        [(1, 0, 0), (0, 1, 0), (0, 0, -1)],
        [(-1, 0, 0), (0, 1, 0), (0, 0, -1)],
        [(0, 1, 0), (1, 0, 0), (0, 0, -1)],
        [(0, -1, 0), (1, 0, 0), (0, 0, -1)],
        [(0, 0, 1), (1, 0, 0), (0, -1, 0)],
        [(0, 0, -1), (1, 0, 0), (0, -1, 0)],
    ]
)
"""Normal, direction of an image's rows and of its columns, for each face of a box, as MuJoCo draws them: mirrored on
three."""


class MjcfGeometry:
    """Converts the geometries of a model. A mesh that several geometries use is converted once."""

    def __init__(self, mujoco: Any, model: Any, max_vertices: int) -> None:
        """Make at most ``max_vertices`` of all meshes with a texture that repeats in different ways."""
        self._model = model
        self._max_vertices = max_vertices
        self._kinds = mujoco.mjtGeom
        self._materials = MjcfMaterials(mujoco, model)
        self._meshes: dict[int, Mesh] = {}
        self._height_fields: dict[int, Mesh | None] = {}
        self._repeated: dict[tuple[int, bytes], tuple[Mesh, Mesh]] = {}
        """Meshes with scaled texture coordinates, by the mesh's id and the scale; each with the mesh itself."""
        self._repeated_vertices = 0
        self.warnings: tuple[str, ...] = ()
        """Sentences about geometry that is not shown. ``parts_by_body`` sets them."""

    def parts_by_body(self, use: GeometryUse) -> tuple[tuple[Part, ...], ...]:
        """Return the parts of each body, in the body's frame."""
        model = self._model
        parts: list[list[Part]] = [[] for _ in range(model.nbody)]
        is_used = self._collides() if use == "collision" else ~self._is_collision_only()
        unsupported = 0
        for index in range(model.ngeom):
            if not is_used[index]:
                continue
            rgba = self._materials.rgba(index)
            if rgba[3] <= 0.0 and use == "visual":
                continue
            shape, has_uv = self._shape(index, use)
            if shape is None:
                unsupported += 1
                continue
            material = self._materials.material(index, has_uv)
            X = from_pose(model.geom_pos[index].tolist(), model.geom_quat[index].tolist())
            parts[int(model.geom_bodyid[index])].append(Part(shape, material, X))
        if unsupported:
            self.warnings = (f"{unsupported} geometries of other types are not shown",)
        return tuple(map(tuple, parts))

    def _collides(self) -> NDArray[np.bool_]:
        """Return a mask of the geometries that can collide, (ngeom,) bool."""
        return np.asarray((self._model.geom_contype != 0) | (self._model.geom_conaffinity != 0))

    def _is_collision_only(self) -> NDArray[np.bool_]:
        """Return a mask, (ngeom,), of the geometries that are for collisions only.

        These are all of ``COLLISION_GROUP`` and higher groups, and colliding ones of group 0 whose body also has
        geometries of group 1 or 2 that do not collide. The world is no such body: a floor is not for collisions only.
        """
        model = self._model
        group = model.geom_group
        collides = self._collides()
        has_visual = np.zeros(model.nbody, np.bool_)
        has_visual[model.geom_bodyid[~collides & (group >= 1) & (group < COLLISION_GROUP)]] = True
        has_visual[0] = False
        return np.asarray((group >= COLLISION_GROUP) | ((group == 0) & collides & has_visual[model.geom_bodyid]))

    def _shape(self, index: int, use: GeometryUse) -> tuple[Shape | None, bool]:
        """Return the shape of a geometry (None: its type is not supported), and True if it has texture coordinates."""
        kind, size = self._kinds(int(self._model.geom_type[index])), self._model.geom_size[index].tolist()
        kinds = self._kinds
        if use == "visual" and (mapped := self._cube_mapped(index, kind)) is not None:
            return Surface(mapped), True
        if kind == kinds.mjGEOM_SPHERE:
            return Sphere(size[0]), False
        if kind == kinds.mjGEOM_CAPSULE:
            return Capsule(size[0], 2.0 * size[1]), False
        if kind == kinds.mjGEOM_CYLINDER:
            return Cylinder(size[0], 2.0 * size[1]), False
        if kind == kinds.mjGEOM_BOX:
            if use == "visual" and self._materials.has_image(index):
                box = _box_mesh(size, _BOX_FACES)
                return Surface(_scaled_uv(box, self._materials.texture_repeats(index))), True
            return Box((2.0 * size[0], 2.0 * size[1], 2.0 * size[2])), False
        if kind == kinds.mjGEOM_ELLIPSOID:
            return Ellipsoid((size[0], size[1], size[2])), False
        if kind == kinds.mjGEOM_PLANE:
            return Surface(self._plane(index, size)), self._materials.has_image(index)
        if kind == kinds.mjGEOM_HFIELD:
            field = self._height_field(index, size)
            return None if field is None else Surface(field), self._materials.has_image(index)
        if kind in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF) and self._model.geom_dataid[index] >= 0:
            mesh = self._mesh(int(self._model.geom_dataid[index]))
            if mesh.uv0 is None or not self._materials.has_image(index):
                return Surface(mesh), False
            return Surface(self._with_repeats(index, mesh, self._materials.texture_repeats(index))), True
        return None, False

    def _plane(self, index: int, size: list[float]) -> Mesh:
        """Return a rectangle at z = 0 with half side lengths ``size[:2]``, metres; 0: infinite."""
        halves = np.array([half if half > 0.0 else INFINITE_PLANE_HALF_SIDE for half in size[:2]])
        plane = rectangle(*(2.0 * halves).tolist())
        infinite = np.asarray(size[:2]) <= 0.0
        # There a texture is 2 m / repeats large, and its middle lies at the origin.
        repeats = self._materials.texture_repeats(index) * np.where(infinite, halves, 1.0)
        return _scaled_uv(plane, repeats, offset=np.where(infinite, 0.5 - repeats / 2.0, 0.0))

    def _with_repeats(
        self, index: int, mesh: Mesh, repeats: NDArray[np.float64], offset: NDArray[np.float64] | float = 0.0
    ) -> Mesh:
        """Return ``_scaled_uv`` if the geometry shows an image, the same mesh for the same arguments.

        Raises RobotFileError for too many vertices.
        """
        if not self._materials.has_image(index) or ((repeats == 1.0).all() and not np.any(offset)):
            return mesh
        key = id(mesh), repeats.tobytes()
        if key not in self._repeated:
            self._check_vertices(len(mesh.positions))
            self._repeated_vertices += len(mesh.positions)
            self._repeated[key] = _scaled_uv(mesh, repeats, offset), mesh
        return self._repeated[key][0]

    def _check_vertices(self, count: int) -> None:
        """Raise RobotFileError if one more mesh of so many vertices, made for a texture, is beyond the limit."""
        check_count(self._repeated_vertices + count, self._max_vertices, "vertices of meshes made for textures")

    def _cube_mapped(self, index: int, kind: Any) -> Mesh | None:
        """Return the mesh of a geometry that shows a cube map, the same one for the same arguments; None for others.

        MuJoCo looks up the map by the position in a mesh, or in a shape of half lengths of 1, which ``texuniform``
        multiplies by the half lengths. Raises RobotFileError for too many vertices.
        """
        cube_map = self._materials.cube_map(index)
        if cube_map is None:
            return None
        kinds, model, data = self._kinds, self._model, int(self._model.geom_dataid[index])
        half_lengths = np.asarray(model.geom_size[index], np.float64)
        scale = np.ones(3)
        if kind in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF) and data >= 0:
            unit = self._mesh(data)
        elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
            scale = half_lengths = half_lengths[[0, 0, 0]] if kind == kinds.mjGEOM_SPHERE else half_lengths
            unit = primitives.sphere()
        elif kind == kinds.mjGEOM_CYLINDER:
            scale = half_lengths = half_lengths[[0, 0, 1]]
            unit = _scaled(primitives.cylinder(), np.array((1.0, 1.0, 2.0)))
        elif kind == kinds.mjGEOM_BOX:
            scale, unit = half_lengths, _scaled(primitives.box(), np.full(3, 2.0))
        else:
            return None
        stretch = half_lengths if model.mat_texuniform[model.geom_matid[index]] else np.ones(3)
        key = id(unit) if data >= 0 else int(kind), np.concatenate((scale, stretch, cube_map)).tobytes()
        if key not in self._repeated:
            self._check_vertices(3 * len(unit.elements))
            mapped = cube_mapped(_scaled(unit, scale), unit.positions * stretch, *cube_map, self._check_vertices)
            self._repeated_vertices += len(mapped.positions)
            self._repeated[key] = mapped, unit
        return self._repeated[key][0]

    def _height_field(self, index: int, size: list[float]) -> Mesh | None:
        """Return the surface of a height field, without its base and sides; None if its heights are not finite.

        ``size[:2]``: half side lengths, metres.
        """
        field = int(self._model.geom_dataid[index])
        if field not in self._height_fields:
            model = self._model
            rows, columns, start = (int(a[field]) for a in (model.hfield_nrow, model.hfield_ncol, model.hfield_adr))
            heights = model.hfield_data[start : start + rows * columns].reshape(rows, columns)
            with np.errstate(all="ignore"):
                heights = (heights * model.hfield_size[field][2]).astype(np.float32)
                self._height_fields[field] = heightmap_mesh(heights, (2.0 * size[0], 2.0 * size[1]), None)
        mesh = self._height_fields[field]
        if mesh is None:
            return None
        # The middle of a texture lies at the origin, its top towards +y.
        repeats = self._materials.texture_repeats(index) * (1.0, -1.0)
        return self._with_repeats(index, mesh, repeats, offset=0.5 - repeats / 2.0)

    def _mesh(self, mesh: int) -> Mesh:
        """Return a mesh with one index for each corner. MuJoCo has separate indices of position, normal and uv."""
        if mesh not in self._meshes:
            model = self._model

            def rows(array: NDArray[Any], start: int, count: int) -> NDArray[Any]:
                return array[start : start + count]

            start, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
            positions = rows(model.mesh_vert, model.mesh_vertadr[mesh], model.mesh_vertnum[mesh])
            normals = rows(model.mesh_normal, model.mesh_normaladr[mesh], model.mesh_normalnum[mesh])
            corners = [rows(model.mesh_face, start, count), rows(model.mesh_facenormal, start, count)]
            uv = None
            if model.mesh_texcoordadr[mesh] >= 0:
                uv = rows(model.mesh_texcoord, model.mesh_texcoordadr[mesh], model.mesh_texcoordnum[mesh])
                corners.append(rows(model.mesh_facetexcoord, start, count))
            indices = np.stack(corners, axis=-1).reshape(3 * count, -1).astype(np.uint32)
            first_corner, triangles = first_of_equal(indices)
            unique = indices[first_corner]
            converted = Mesh(
                np.ascontiguousarray(positions[unique[:, 0]], np.float32),
                triangles.reshape(-1, 3),
                normals=np.ascontiguousarray(normals[unique[:, 1]], np.float32),
                uv0=None if uv is None else np.ascontiguousarray(uv[unique[:, 2]], np.float32),
            )
            is_normal_of_vertex = np.array_equal(corners[0], corners[1])
            self._meshes[mesh] = _with_outward_normals(converted) if is_normal_of_vertex else converted
        return self._meshes[mesh]


def _with_outward_normals(mesh: Mesh) -> Mesh:
    """Return a mesh with computed normals if one of its own points to the back of a triangle, else the mesh.

    MuJoCo computes one normal for each vertex of an STL file. It is the z axis if no triangle there is within 36.9
    degrees of their mean, as at corners of boxes. MuJoCo's renderer leaves such normals out.
    """
    assert mesh.normals is not None
    a, b, c = (mesh.positions[mesh.elements[:, corner]] for corner in range(3))
    cosines = np.einsum("fi,fci->fc", np.cross(b - a, c - a), mesh.normals[mesh.elements])
    if not (cosines < 0.0).any():
        return mesh
    from gateway.scene.draw.crease_normals import with_creases  # here, because it loads kernels

    return with_creases(mesh.positions, mesh.elements, uv=mesh.uv0)


def _scaled(mesh: Mesh, factors: NDArray[np.float64]) -> Mesh:
    """Return a mesh with its positions multiplied by factors above 0, (3,)."""
    if (factors == 1.0).all():
        return mesh
    assert mesh.normals is not None
    normals = mesh.normals / factors
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(mesh, positions=(mesh.positions * factors).astype(np.float32), normals=normals.astype(np.float32))


def _scaled_uv(mesh: Mesh, repeats: NDArray[np.float64], offset: NDArray[np.float64] | float = 0.0) -> Mesh:
    """Return the mesh with its texture coordinates multiplied by the repetitions along u and v, plus an offset."""
    assert mesh.uv0 is not None
    with np.errstate(all="ignore"):
        uv = (mesh.uv0 * repeats + offset).astype(np.float32)
    return replace(mesh, uv0=np.nan_to_num(uv, posinf=0.0, neginf=0.0))


def _box_mesh(half_lengths: list[float], faces: NDArray[np.int64]) -> Mesh:
    box = textured_box(np.array(half_lengths), faces)
    return Mesh(box.positions, box.triangles, box.normals, uv0=box.uv)
