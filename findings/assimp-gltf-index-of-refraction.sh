#!/usr/bin/env bash
# Package: cmeel-assimp 6.0.5 (Assimp 6.0.5).
# Wrong belief: an OBJ material that names no index of refraction (Ni) gets none in glTF, whose default of 1.5 is that of plastic.
# Behaviour: Assimp writes KHR_materials_ior with 1, that of air. With the Ks that it writes as KHR_materials_specular, too, it is
# (1 - 1)^2 / (1 + 1)^2 = 0: no light is reflected but at grazing angles, whatever Ks is.
# Why it matters: converted models lose their highlights in all viewers that know the extension, three.js and Blender among them.
# Seen 2026-11-30: Ks 0.5 and no Ni: specularColorFactor 0.5, ior 1; with Ni 1.45, ior 1.45.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check cmeel-assimp==6.0.5
assimp=$(echo venv/lib/python3*/site-packages/cmeel.prefix)
export LD_LIBRARY_PATH=$assimp/lib

for name in without with; do
  printf 'mtllib %s.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' $name > $name.obj
  printf 'newmtl red\nKd 0.8 0.2 0.1\nKs 0.5 0.5 0.5\n' > $name.mtl
done
echo 'Ni 1.45' >> with.mtl
for name in without with; do
  "$assimp/bin/assimp" export $name.obj $name.gltf -fgltf2 > log || { cat log; exit 1; }
done

venv/bin/python - <<'PYTHON'
import json

found = {}
for name in ("without", "with"):
    with open(f"{name}.gltf") as file:
        document = json.load(file)
    (material,) = [each for each in document["materials"] if each["name"] == "red"]
    extensions = material["extensions"]
    specular = extensions["KHR_materials_specular"]["specularColorFactor"]
    found[name] = specular, round(extensions["KHR_materials_ior"]["ior"], 4)
print(found)
assert found == {"without": ([0.5] * 3, 1.0), "with": ([0.5] * 3, 1.45)}
PYTHON
