#!/usr/bin/env bash
# Package: bpy 5.0.1 (Blender), 300 MB; its wheels are for Python 3.11.
# Wrong belief: Kd in the MTL file that Blender exports is the colour that the same material has as a texture.
# Behaviour: Kd is the linear base colour, while images of map_Kd stay sRGB. Most readers, such as three.js, trimesh and Drake,
#   take Kd for sRGB.
# Why it matters: plain colours get darker, those with a texture do not; a grey of 188 of 255 is shown as 128.
# Seen 2026-11-29: a base colour that is seen as 188 of 255 is written as Kd 0.50, which is 128.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3.11 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check bpy==5.0.1

venv/bin/python - <<'PYTHON'
import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_cube_add()
material = bpy.data.materials.new("grey")
material.use_nodes = True
linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (linear, linear, linear, 1)
bpy.context.object.data.materials.append(material)
bpy.ops.wm.obj_export(filepath="box.obj")
(kd,) = [line.split()[1:] for line in open("box.mtl") if line.startswith("Kd ")]
print("a base colour that is seen as 188 of 255 is written as Kd", *kd)
assert all(round(255 * float(channel)) in (127, 128) for channel in kd)
PYTHON
