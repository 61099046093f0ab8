#!/usr/bin/env bash
# Package: trimesh 5.2.0.
# Wrong belief: colours of a PLY file are scaled by their type, as positions are read in whatever type they have.
# Behaviour: 16-bit colours (ushort) are cut to their low byte: 32896, half, becomes 128 by luck, 1000, nearly black,
#   becomes 232. Floats from 0 to 255 are all 255 above 1. Nothing warns.
# Why it matters: scans with 16-bit or float colours load with noise, or white.
# Seen 2026-11-29: uchar [220, 40, 10]; ushort [255, 128, 232]; float [255, 255, 255].
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 trimesh==5.2.0

venv/bin/python - <<'PYTHON'
import io

import trimesh


def color(kind: str, *channels: float) -> list[int]:
    """Return the colour that trimesh reads of a triangle's first vertex."""
    header = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {axis}" for axis in "xyz")]
    header += [f"property {kind} {name}" for name in ("red", "green", "blue")]
    header += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    rows = [f"{place} {' '.join(map(str, channels))}" for place in ("0 0 0", "1 0 0", "0 1 0")]
    text = "\n".join([*header, *rows, "3 0 1 2", ""])
    mesh = trimesh.load(io.BytesIO(text.encode()), file_type="ply", process=False)
    return mesh.visual.vertex_colors[0, :3].tolist()


print(color("uchar", 220, 40, 10), color("ushort", 65535, 32896, 1000), color("float", 220.0, 40.0, 10.0))
assert color("uchar", 220, 40, 10) == [220, 40, 10]
assert color("ushort", 65535, 32896, 1000) == [255, 128, 1000 % 256]
assert color("float", 220.0, 40.0, 10.0) == [255, 255, 255]
PYTHON
