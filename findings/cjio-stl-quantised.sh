#!/usr/bin/env bash
# Package: cjio 0.10.1 (CityJSON).
# Wrong belief: `export stl` writes the city in its coordinates, as `export obj` and `export glb` do.
# Behaviour: STL files have the integers of the CityJSON file, before its `transform`: neither its scale nor its translation. With the
#   usual scale of 0.001 a metre is 1000. Scales may differ by axis: then the model is squeezed, too.
# Why it matters: two tiles, which have translations of their own, lie on each other; a height of 30 m is 30,000.
# Seen 2026-12-01: a box of 10 x 20 x 30 m at (85000, 446000) is so in OBJ, and 10000 x 20000 x 15000 at the origin in STL, with a scale
#   of 0.002 along z.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check cjio==0.10.1 click==8.5.1 numpy==2.4.6 mapbox-earcut==2.1.0 triangle==20250106

cat > city.py <<'PYTHON'
import json

CORNERS = [(x, y, z) for z in (0, 15_000) for x, y in ((0, 0), (10_000, 0), (10_000, 20_000), (0, 20_000))]
SIDES = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
solid = {"type": "Solid", "lod": "2", "boundaries": [[[list(side)] for side in SIDES]]}
city = {
    "type": "CityJSON",
    "version": "2.0",
    "transform": {"scale": [0.001, 0.001, 0.002], "translate": [85_000.0, 446_000.0, 0.0]},
    "CityObjects": {"building": {"type": "Building", "geometry": [solid]}},
    "vertices": CORNERS,
}
json.dump(city, open("city.json", "w"))
PYTHON
cat > check.py <<'PYTHON'
def bounds(path, keyword):
    words = (line.split() for line in open(path))
    points = [tuple(map(float, row[1:])) for row in words if row and row[0] == keyword]
    low, high = (tuple(f(axis) for axis in zip(*points)) for f in (min, max))
    print(path, low, high)
    return low, high


assert bounds("city.obj", "v") == ((85000.0, 446000.0, 0.0), (85010.0, 446020.0, 30.0))
assert bounds("city.stl", "vertex") == ((0.0, 0.0, 0.0), (10000.0, 20000.0, 15000.0))
PYTHON
venv/bin/python city.py
for format in obj stl; do venv/bin/cjio city.json export $format city.$format > /dev/null; done
venv/bin/python check.py
