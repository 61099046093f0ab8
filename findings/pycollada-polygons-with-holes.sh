#!/usr/bin/env bash
# Package: pycollada 0.9.3.
# Wrong belief: a polygon with a hole is read without the hole, at worst.
# Behaviour: it is not read at all, and document.errors stays empty: only the polygons without holes are left.
# Why it matters: trimesh, urdfpy and yourdfpy read COLLADA files with it; walls with windows, plates with bores are missing.
# Seen 2026-11-29: 1 polygon of 2, no error.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 pycollada==0.9.3

venv/bin/python - <<'PYTHON'
import io

import collada

CORNERS = "0 0 0 3 0 0 3 3 0 0 3 0 1 1 0 1 2 0 2 2 0 2 1 0"
TEXT = f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="24">{CORNERS}</float_array>
<technique_common><accessor source="#a" count="8" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polygons count="2"><input semantic="VERTEX" source="#v" offset="0"/><p>4 5 6 7</p>
<ph><p>0 1 2 3</p><h>4 5 6 7</h></ph></polygons></mesh></geometry></library_geometries></COLLADA>"""
document = collada.Collada(io.BytesIO(TEXT.encode()), ignore=[collada.DaeError])
(polygons,) = document.geometries[0].primitives
print(len(polygons), document.errors)
assert (len(polygons), document.errors) == (1, [])
PYTHON
