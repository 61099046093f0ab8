#!/usr/bin/env bash
# Package: build123d 0.13.0.
# Wrong belief: scale(part, 1000) makes millimetres of metres, and changes nothing else.
# Behaviour: each part grows about its own place, which stays where it was, and loses its colour and label; rotate() and cuts keep them.
# Why it matters: an assembly that is scaled part by part collapses, and its glTF file is white.
# Seen 2026-11-29: a red box whose place is x = 1 spans 0.9 to 1.1, scaled by 10 it spans 0 to 2 instead of 9 to 11, without a colour.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check build123d==0.13.0

venv/bin/python - <<'PYTHON'
from build123d import Axis, Box, Color, Pos, scale

part = Pos(1, 0, 0) * Box(0.2, 0.2, 0.2)
part.color, part.label = Color(1, 0, 0), "tool"
turned, scaled = part.rotate(Axis.X, 90), scale(part, 10)
box = scaled.bounding_box()
print(round(box.min.X, 6), round(box.max.X, 6), scaled.color, repr(scaled.label), repr(turned.label))
assert (round(box.min.X, 6), round(box.max.X, 6)) == (0.0, 2.0)
assert (scaled.color, scaled.label) == (None, "")
assert turned.color is not None and turned.label == "tool"
PYTHON
