"""Renders a glTF scene over HTTP: colour, depth and label picture of one triangle.

    python examples/render_http.py [http://127.0.0.1:8000] [FOLDER]

Drake's client sends the same form; nothing but the standard library is needed to do it by hand.
"""

import base64
import json
import struct
import sys
import urllib.request
from pathlib import Path

url = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8000"
folder = Path(sys.argv[2] if len(sys.argv) > 2 else ".")

corners = struct.pack("<9f", -1, -1, 0, 1, -1, 0, 0, 1, 0)
scene = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0, 1]}],
    # A glTF camera looks along -Z: this one stands 3 m above the triangle.
    "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0, 0, 3]}],
    "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
    "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0, 1], "metallicFactor": 0}}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"byteLength": 36, "uri": "data:;base64," + base64.b64encode(corners).decode()}],
}
intrinsics = {"width": 320, "height": 240, "focal_x": 280, "focal_y": 280, "center_x": 160, "center_y": 120}
planes = {"near": 0.1, "far": 10, "min_depth": 0.1, "max_depth": 10}

gateway = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # no proxy, whatever http_proxy says
for image_type, suffix in (("color", ".png"), ("depth", ".tiff"), ("label", ".png")):
    form = {"image_type": image_type, **intrinsics, **planes}
    boundary = "scenegate-example"
    parts = [f'--{boundary}\r\nContent-Disposition: form-data; name="{k}"\r\n\r\n{v}\r\n' for k, v in form.items()]
    parts.append(f'--{boundary}\r\nContent-Disposition: form-data; name="scene"; filename="scene.gltf"\r\n\r\n')
    body = "".join(parts) + json.dumps(scene) + f"\r\n--{boundary}--\r\n"
    headers = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
    with gateway.open(urllib.request.Request(f"{url}/render", body.encode(), headers)) as answer:
        path = folder / f"{image_type}{suffix}"
        path.write_bytes(answer.read())
    print(path)
