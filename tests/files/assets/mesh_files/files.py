"""Small mesh files, written by hand."""

import struct
from pathlib import Path

import cv2
import numpy as np

from gateway.files.assets.mesh_files import MeshFiles
from gateway.scene.tree.geometry import Part, Surface
from renderers.drawlist import Mesh

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n"
CUBE = """mtllib cube.mtl
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
usemtl painted
f 1/1 4/4 3/3 2/2\nf 5/1 6/2 7/3 8/4
usemtl glass
f 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8
"""
CUBE_MTL = "newmtl painted\nKd 0.1 0.1 0.1\nmap_Kd textures/paint.png\nnewmtl glass\nKd 1 0 0.5\nd 0.25\n"
DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset>{asset}</asset>
 <library_geometries><geometry id="g"><mesh>
  <source id="p"><float_array id="pa" count="9">0 0 0 1 0 0 0 2 0</float_array><technique_common>
   <accessor source="#pa" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
   <param name="Z" type="float"/></accessor></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  <triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="s"><node id="n"><translate>0 0 5</translate>
  <instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""


def write(path: Path, content: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def png(*pixels: tuple[int, int, int]) -> bytes:
    ok, data = cv2.imencode(".png", np.array([[(b, g, r) for r, g, b in pixels]], np.uint8))
    assert ok
    return data.tobytes()


def source(name: str, numbers: str, parameters: str) -> str:
    """A ``<source>`` of COLLADA, of floats whose parameters have names of one letter."""
    count, stride = len(numbers.split()), len(parameters)
    names = "".join(f'<param name="{parameter}" type="float"/>' for parameter in parameters)
    return (
        f'<source id="{name}"><float_array id="{name}a" count="{count}">{numbers}</float_array><technique_common>'
        f'<accessor source="#{name}a" count="{count // stride}" stride="{stride}">{names}</accessor></technique_common>'
        "</source>"
    )


def stl(mesh: Mesh) -> bytes:
    corners = mesh.positions[mesh.elements]
    rows = np.zeros(len(corners), np.dtype([("n", "<3f4"), ("v", "<9f4"), ("a", "<u2")]))
    rows["v"] = corners.reshape(-1, 9)
    return b"\0" * 80 + struct.pack("<I", len(corners)) + rows.tobytes()


def ply(vertices: int, rows: str, *properties: str, faces: int = 0, comments: str = "") -> str:
    """A PLY file in ASCII, whose vertices have further properties."""
    lines = (*(f"float {axis}" for axis in "xyz"), *properties)
    head = f"ply\nformat ascii 1.0\n{comments}element vertex {vertices}\n"
    head += "".join(f"property {line}\n" for line in lines)
    if faces:
        head += f"element face {faces}\nproperty list uchar int vertex_indices\n"
    return f"{head}end_header\n{rows}"


RGB = ("uchar red", "uchar green", "uchar blue")


def load_one(files: MeshFiles, name: str) -> tuple[Part, list[str]]:
    """The one part of a file, and the warnings of loading it."""
    warnings: list[str] = []
    (part,) = files.load(name, warnings=warnings)
    return part, warnings


def load_painted(
    files: MeshFiles, root: Path, material: str, uv: str = "vt 0 0\n", corners: str = "1/1 2/1 3/1"
) -> tuple[Part, list[str]]:
    """Load ``t.obj``, a triangle with the material ``m`` of ``t.mtl``."""
    write(root / "t.mtl", f"newmtl m\n{material}\n")
    write(root / "t.obj", "mtllib t.mtl\n" + uv + TRIANGLE.replace("f 1 2 3", f"usemtl m\nf {corners}"))
    return load_one(files, "t.obj")


def mesh_of(part: Part) -> Mesh:
    assert isinstance(part.shape, Surface)
    return part.shape.mesh


def gltf(generator: str) -> str:
    return (
        '{"asset":{"version":"2.0","generator":"' + generator + '"},"scene":0,"scenes":[{"nodes":[0]}],'
        '"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],'
        '"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,2,0]}],'
        '"bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"data.bin"}]}'
    )
