#!/usr/bin/env bash
# Package: cmeel-assimp 6.0.5 (Assimp 6.0.5; Pinocchio and coal read their meshes with it).
# Wrong belief: a mesh of an OBJ file whose vertices have no colours has none after reading, or white, by which nothing changes.
# Behaviour: if any vertex of the file has a colour, all others get black, also those of other objects.
# Why it matters: one coloured part (MeshLab writes colours behind the coordinates) makes all other parts of the file black.
# Seen 2026-12-01: COLOR_0 of the mesh without colours is (0, 0, 0, 1) in glTF; without the other mesh there is no COLOR_0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check cmeel==0.62.0 cmeel-zlib==1.3.2 cmeel-assimp==6.0.5
assimp=$(echo venv/lib/python3*/site-packages/cmeel.prefix)
export LD_LIBRARY_PATH=$assimp/lib

printf 'o plain\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' > plain.obj
cp plain.obj both.obj
printf 'o coloured\nv 5 0 0 1 0 0\nv 6 0 0 1 0 0\nv 5 1 0 1 0 0\nf 4 5 6\n' >> both.obj
for name in plain both; do
  "$assimp/bin/assimp" export $name.obj $name.gltf -fgltf2 > log || { cat log; exit 1; }
done

venv/bin/python - <<'PYTHON'
import json
import struct


def colours(name):
    document = json.load(open(f"{name}.gltf"))
    data = open(document["buffers"][0]["uri"], "rb").read()
    found = {}
    for mesh in document["meshes"]:
        number = mesh["primitives"][0]["attributes"].get("COLOR_0")
        if number is not None:
            accessor = document["accessors"][number]
            start = document["bufferViews"][accessor["bufferView"]].get("byteOffset", 0) + accessor.get("byteOffset", 0)
            assert (accessor["componentType"], accessor["type"]) == (5126, "VEC4")
            found[mesh["name"]] = struct.unpack_from("<4f", data, start)
    return found


print("alone:", colours("plain"), "beside a coloured mesh:", colours("both"))
assert colours("plain") == {}
assert sorted(colours("both").values()) == [(0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0)]
PYTHON
