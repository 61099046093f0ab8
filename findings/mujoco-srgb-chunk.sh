#!/usr/bin/env bash
# Package: mujoco 4.0.0; its renderer needs EGL, in software, too (Mesa).
# Wrong belief: two PNG files with the same pixels look the same as textures; sRGB is what PNG colours are anyway.
# Behaviour: an sRGB chunk, an optional part of PNG files, makes colorspace="auto" take it for sRGB, and the texture is
#   drawn as linear values that nothing turns back. colorspace="linear" draws the pixels as they are.
# Why it matters: textures get darker when a program saved them once more, and images of one simulator no longer fit another's.
# Seen 2026-11-30: a grey of 128 is drawn as 128 without the chunk, as 55 with it, as 128 with it and colorspace="linear".
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0
MUJOCO_GL=egl venv/bin/python - <<'PYTHON'
import struct
import zlib

import mujoco


def png(*extra: bytes) -> bytes:
    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", 8, 8, 8, 2, 0, 0, 0)
    rows = (b"\0" + bytes((128, 128, 128)) * 8) * 8
    chunks = [(b"IHDR", header), *((kind, b"\0") for kind in extra), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*each) for each in chunks)


def drawn(image: bytes, color_space: str) -> int:
    model = mujoco.MjModel.from_xml_string(
        f"""
<mujoco>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <asset>
    <texture name="t" type="2d" file="t.png" colorspace="{color_space}"/>
    <material name="m" texture="t"/>
  </asset>
  <worldbody><geom type="plane" size="5 5 0.1" material="m"/></worldbody>
</mujoco>""",
        {"t.png": image},
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.distance, camera.elevation = 3, -90
    renderer = mujoco.Renderer(model, 64, 64)
    renderer.update_scene(data, camera)
    return int(renderer.render()[32, 32, 0])


values = drawn(png(), "auto"), drawn(png(b"sRGB"), "auto"), drawn(png(b"sRGB"), "linear")
print("without the chunk, with it, with it and colorspace linear:", *values)
assert abs(values[0] - 128) <= 1
assert abs(values[1] - 55) <= 1
assert abs(values[2] - 128) <= 1
PYTHON
