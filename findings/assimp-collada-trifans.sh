#!/usr/bin/env bash
# Package: cmeel-assimp 6.0.5 (Assimp 6.0.5; Pinocchio and coal read their meshes with it).
# Wrong belief: <trifans> of a COLLADA file are triangles, whose edges all meet in the fan's first vertex.
# Behaviour: Assimp reads each fan as one polygon, and may cut it along other edges when it makes triangles.
# Why it matters: surfaces that are not flat get other shapes. The duck of Khronos' conformance tests, as fans, has an area of 7.07 in place of 7.02.
# Seen 2026-11-30: a fan of two triangles becomes one face of four corners; with -tri two triangles, both others.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check cmeel-assimp==6.0.5
assimp=$(echo venv/lib/python3*/site-packages/cmeel.prefix)
export LD_LIBRARY_PATH=$assimp/lib

venv/bin/python - <<'PYTHON'
CORNERS = "0 0 1 2 -1 -2 2 1 -2 2 0 -1"
for name, primitives in (
    ("fan", '<trifans count="1">{}<p>0 1 2 3</p></trifans>'),
    ("triangles", '<triangles count="2">{}<p>0 1 2 0 2 3</p></triangles>'),
):
    primitives = primitives.format('<input semantic="VERTEX" source="#v" offset="0"/>')
    with open(f"{name}.dae", "w") as file:
        file.write(f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2026-01-01T00:00:00</created><modified>2026-01-01T00:00:00</modified></asset>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="12">{CORNERS}</float_array>
<technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{primitives}</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>""")
PYTHON
for name in fan triangles; do
  "$assimp/bin/assimp" export $name.dae $name.obj -fobj > log || { cat log; exit 1; }
  "$assimp/bin/assimp" export $name.dae ${name}_cut.obj -fobj -tri > log || { cat log; exit 1; }
done

venv/bin/python - <<'PYTHON'
def faces(name):
    """Return the faces of an OBJ file, as sets of their corners' coordinates."""
    with open(f"{name}.obj") as file:
        rows = [line.split() for line in file]
    vertices = [tuple(map(float, row[1:4])) for row in rows if row[:1] == ["v"]]
    return {frozenset(vertices[int(corner.split("/")[0]) - 1] for corner in row[1:]) for row in rows if row[:1] == ["f"]}


sizes = [len(face) for face in faces("fan")]
common = len(faces("fan_cut") & faces("triangles_cut"))
print(sizes, len(faces("fan_cut")), common)
assert sizes == [4]
assert faces("triangles") == faces("triangles_cut")
assert (len(faces("fan_cut")), common) == (2, 0)
PYTHON
