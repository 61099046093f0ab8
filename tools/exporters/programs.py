"""Write the scene of two boxes with one package: ``python programs.py PACKAGE FOLDER``, in an environment that has it.

Each function writes what the package's documentation shows, in the package's own unit and up axis.
"""

import json
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

BOXES: list[dict[str, Any]] = json.loads(Path(__file__).with_name("boxes.json").read_text())
"""Name, size and centre in metres with Z up, turn about the vertical in degrees, and sRGB colour of each box."""
CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
TRIANGLES = np.array([triangle for a, b, c, d in SIDES for triangle in ((a, b, c), (a, c, d))])


def pose_of(box: dict[str, Any]) -> NDArray[np.float64]:
    """Return the (4, 4) pose of a box."""
    c, s = np.cos(np.radians(box["turn"])), np.sin(np.radians(box["turn"]))
    x, y, z = box["center"]
    return np.array([(c, -s, 0, x), (s, c, 0, y), (0, 0, 1, z), (0, 0, 0, 1)])


def corners_of(box: dict[str, Any]) -> NDArray[np.float64]:
    """Return the (8, 3) corners of a box in the world."""
    pose = pose_of(box)
    corners: NDArray[np.float64] = CORNERS * box["size"] @ pose[:3, :3].T + pose[:3, 3]
    return corners


def linear_of(color: list[int]) -> list[float]:
    """Return a colour as linear red, green and blue from 0 to 1."""
    return [((channel / 255 + 0.055) / 1.055) ** 2.4 for channel in color]


def bpy(folder: Path) -> None:
    import bpy

    def new_scene(*, with_attribute: bool) -> None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        for box in BOXES:
            turn = (0, 0, np.radians(box["turn"]))
            bpy.ops.mesh.primitive_cube_add(size=1, location=box["center"], rotation=turn, scale=box["size"])
            mesh, color = bpy.context.object.data, (*linear_of(box["color"]), 1)
            mesh.materials.append(bpy.data.materials.new(box["name"]))
            if with_attribute:
                for corner in mesh.color_attributes.new("Color", "BYTE_COLOR", "CORNER").data:
                    corner.color = color
            else:
                mesh.materials[0].use_nodes = True
                mesh.materials[0].node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = color

    new_scene(with_attribute=False)
    bpy.ops.export_scene.gltf(filepath=str(folder / "bpy.glb"))
    bpy.ops.export_scene.gltf(filepath=str(folder / "bpy_z_up.glb"), export_yup=False)
    bpy.ops.export_scene.gltf(filepath=str(folder / "bpy_draco.glb"), export_draco_mesh_compression_enable=True)
    bpy.ops.wm.obj_export(filepath=str(folder / "bpy.obj"))
    new_scene(with_attribute=True)
    bpy.ops.export_scene.gltf(filepath=str(folder / "bpy_attribute.glb"))
    bpy.ops.wm.ply_export(filepath=str(folder / "bpy_attribute.ply"), ascii_format=True)
    bpy.ops.wm.obj_export(filepath=str(folder / "bpy_attribute.obj"), export_colors=True, export_materials=False)


def cadquery(folder: Path) -> None:
    import cadquery as cq

    for name, unit in (("cadquery_mm", 1000), ("cadquery_m", 1)):
        assembly = cq.Assembly(name="boxes")
        for box in BOXES:
            place = cq.Location(cq.Vector(*(unit * c for c in box["center"])), cq.Vector(0, 0, 1), box["turn"])
            solid, color = cq.Workplane().box(*(unit * s for s in box["size"])), cq.Color(*np.divide(box["color"], 255))
            assembly.add(solid, loc=place, name=box["name"], color=color)
        assembly.export(str(folder / f"{name}.glb"))
        if unit == 1000:
            cq.exporters.export(cq.Workplane(assembly.toCompound()), str(folder / f"{name}.stl"))


def dracopy(folder: Path) -> None:
    """DracoPy compresses; the GLB around it is written by hand."""
    import DracoPy

    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "DracoPy 2.2.0"},
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"mesh": 1}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0}}],
        "extensionsUsed": ["KHR_draco_mesh_compression"],
        "extensionsRequired": ["KHR_draco_mesh_compression"],
        **{name: [] for name in ("meshes", "accessors", "bufferViews")},
    }
    blob = b""
    for number, box in enumerate(BOXES):
        points = np.float32(corners_of(box) @ [(1, 0, 0), (0, 0, -1), (0, 1, 0)])  # Y up
        colors = np.tile(np.uint8(np.round(255 * np.array(linear_of(box["color"])))), (8, 1))
        data = DracoPy.encode(points, TRIANGLES, colors=colors, quantization_bits=14)
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        blob += data + b"\0" * (-len(data) % 4)
        low, high, first = points.min(axis=0).tolist(), points.max(axis=0).tolist(), 3 * number
        document["accessors"] += [
            {"componentType": 5126, "count": 8, "type": "VEC3", "min": low, "max": high},
            {"componentType": 5121, "count": 8, "type": "VEC3", "normalized": True},
            {"componentType": 5125, "count": 36, "type": "SCALAR"},
        ]
        # DracoPy numbers colours first.
        draco = {"bufferView": number, "attributes": {"POSITION": 1, "COLOR_0": 0}}
        primitive = {
            "attributes": {"POSITION": first, "COLOR_0": first + 1},
            "indices": first + 2,
            "material": 0,
            "extensions": {"KHR_draco_mesh_compression": draco},
        }
        document["meshes"].append({"primitives": [primitive]})
    document["buffers"] = [{"byteLength": len(blob)}]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    (folder / "dracopy.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def open3d(folder: Path) -> None:
    import open3d as o3d

    both = o3d.geometry.TriangleMesh()
    for box in BOXES:
        mesh = o3d.geometry.TriangleMesh.create_box(*box["size"])
        mesh.translate(np.divide(box["size"], -2))
        mesh.transform(pose_of(box))
        mesh.paint_uniform_color(np.divide(box["color"], 255))
        mesh.compute_vertex_normals()
        both += mesh
    for name, options in (("open3d.glb", {}), ("open3d.obj", {}), ("open3d.ply", {"write_ascii": True})):
        o3d.io.write_triangle_mesh(str(folder / name), both, **options)


def pymeshlab(folder: Path) -> None:
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    for box in BOXES:
        color = np.tile((*np.divide(box["color"], 255), 1.0), (8, 1))
        meshes.add_mesh(pymeshlab.Mesh(corners_of(box), TRIANGLES, v_color_matrix=color))
    meshes.generate_by_merging_visible_meshes()
    for suffix in ("dae", "obj", "ply"):
        meshes.save_current_mesh(str(folder / f"pymeshlab.{suffix}"))


def pyvista(folder: Path) -> None:
    import pyvista as pv

    def cubes() -> list[Any]:
        sizes = [dict(zip(("x_length", "y_length", "z_length"), box["size"], strict=True)) for box in BOXES]
        return [pv.Cube(**size).transform(pose_of(box), inplace=False) for size, box in zip(sizes, BOXES, strict=True)]

    plotter = pv.Plotter(off_screen=True)
    for cube, box in zip(cubes(), BOXES, strict=True):
        plotter.add_mesh(cube, color=box["color"])
    plotter.export_gltf(folder / "pyvista.gltf")
    plotter.export_gltf(folder / "pyvista_z_up.gltf", rotate_scene=False)
    plotter.export_obj(folder / "pyvista.obj")
    colored, by_number = pv.Plotter(off_screen=True), pv.Plotter(off_screen=True)
    cells = cubes()
    for number, (cube, box) in enumerate(zip(cells, BOXES, strict=True)):
        numbered = cube.copy()
        numbered["number"] = np.full(cube.n_points, float(number))
        by_number.add_mesh(numbered, scalars="number", clim=(0, 1), show_scalar_bar=False)
        cube.cell_data["color"] = np.tile(np.uint8(box["color"]), (cube.n_cells, 1))
        colored.add_mesh(cube, scalars="color", rgb=True)
    colored.export_gltf(folder / "pyvista_cells.gltf")
    by_number.export_gltf(folder / "pyvista_scalars.gltf")
    pv.merge(cells).triangulate().save(folder / "pyvista_cells.vtk", binary=False)
    surface = pv.merge(cubes()).triangulate()
    colors = np.repeat(np.array([box["color"] for box in BOXES], np.uint8), surface.n_points // len(BOXES), axis=0)
    surface.save(folder / "pyvista.ply", texture=colors, binary=False)


def trimesh(folder: Path) -> None:
    import trimesh

    def scene_of(kind: str) -> Any:
        scene = trimesh.Scene()
        for box in BOXES:
            mesh, color = trimesh.creation.box(extents=box["size"]), [*box["color"], 255]
            if kind == "faces":
                mesh.visual.face_colors = color
            else:
                material = trimesh.visual.material
                simple, pbr = material.SimpleMaterial(diffuse=color), material.PBRMaterial(baseColorFactor=color)
                uv = np.zeros((len(mesh.vertices), 2))
                mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=pbr if kind == "pbr" else simple)
            scene.add_geometry(mesh, node_name=box["name"], transform=pose_of(box))
        return scene

    scene_of("pbr").export(folder / "trimesh_pbr.glb")
    scene_of("simple").export(folder / "trimesh_simple.glb")
    faces = scene_of("faces")
    faces.export(folder / "trimesh_faces.glb")
    faces.export(folder / "trimesh_faces.obj")
    faces.to_mesh().export(folder / "trimesh_faces.ply", encoding="ascii")
    (folder / "trimesh_faces.dae").write_bytes(trimesh.exchange.dae.export_collada(faces.dump()))


if __name__ == "__main__":
    globals()[sys.argv[1]](Path(sys.argv[2]))
