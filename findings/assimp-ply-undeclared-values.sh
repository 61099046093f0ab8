#!/usr/bin/env bash
# Package: cmeel-assimp 6.0.5 (Assimp 6.0.5).
# Wrong belief: a PLY file that Assimp writes has the properties that its header names.
# Behaviour: colours of vertices are written and not declared; texture coordinates are written and declared as colours. Binary files have
#   the same header, so that each row begins in the middle of another one.
# Why it matters: readers refuse the file or take its bytes for other coordinates; of a binary file they show a mesh that is none.
# Seen 2026-11-30: a triangle with colours: 3 properties, 7 values a row; with texture coordinates: 7 properties, 5 values; without both 3
#   and 3.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check cmeel-assimp==6.0.5
assimp=$(echo venv/lib/python3*/site-packages/cmeel.prefix)
export LD_LIBRARY_PATH=$assimp/lib

printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' > plain.obj
printf 'v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n' > colors.obj
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n' > uv.obj
for name in plain colors uv; do
  "$assimp/bin/assimp" export $name.obj $name.ply > log || { cat log; exit 1; }
done

venv/bin/python - <<'PYTHON'
counts = {}
for name in ("plain", "colors", "uv"):
    with open(f"{name}.ply") as file:
        header, rows = file.read().split("end_header\n")
    properties = [line for line in header.splitlines() if line.startswith("property") and "list" not in line]
    counts[name] = (len(properties), len(rows.splitlines()[0].split()))
print(counts)
assert counts == {"plain": (3, 3), "colors": (3, 7), "uv": (7, 5)}
PYTHON
