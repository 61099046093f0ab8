#!/usr/bin/env bash
# Package: numpy-stl 4.1.1.
# Wrong belief: the normals of facets in a saved STL file are unit vectors, as the format says, whether or not they were set.
# Behaviour: they are cross products, twice as long as the area of the facet, in text and binary files. Unit normals of a file that is
#   read are replaced by these, too, so that a file that was only read and saved has others.
# Why it matters: programs that take normals from the file, for lighting or for angles to an axis, are wrong by the facet's area: one
#   in millimetres has normals of length 100, the same in metres of 0.0001.
# Seen 2026-12-01: a normal of (0, 0, 100) for a triangle of 10 by 10; (0, 0, 1) becomes (0, 0, 100) when a file is read and saved.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 numpy-stl==4.1.1 python-utils==4.2.0 typing-extensions==4.16.0

venv/bin/python - <<'PYTHON'
import struct

import stl

UNIT = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 10 0 0\nvertex 0 10 0\nendloop\nendfacet\nendsolid a\n"
open("unit.stl", "w").write(UNIT)
mesh = stl.Mesh.from_file("unit.stl")
mesh.save("binary.stl", mode=stl.Mode.BINARY)
mesh.save("text.stl", mode=stl.Mode.ASCII)
binary = struct.unpack_from("<3f", open("binary.stl", "rb").read(), 84)
(text,) = (line for line in open("text.stl").read().splitlines() if "normal" in line)
print("binary:", binary, "text:", text)
assert binary == (0.0, 0.0, 100.0)
assert [float(number) for number in text.split()[2:]] == [0.0, 0.0, 100.0]
PYTHON
