"""The page's types in protocol.ts are those of the messages that the server sends and receives.

TypeScript's compiler reads the messages of a server as values of the page's types. It reports fields that a type does
not have, required ones that a message does not have, and optional ones that no message has.
"""

from __future__ import annotations

import asyncio
import gc
import json
import shutil
import subprocess
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from gateway.app import create_app
from gateway.scene.cameras import LookAtCamera
from gateway.scene.clicks import Button
from gateway.scene.geometry import Box, Part, PointCloud, Surface
from gateway.scene.live import LiveTree, Snapshot
from gateway.scene.live_page import LivePage
from gateway.settings import Settings
from gateway.viewer.config import ViewerConfig
from gateway.viewer.encoder import encode_stereo_rig
from gateway.viewer.frames import parse_frame
from gateway.viewer.hub import ViewHub
from gateway.viewer.routes import _Click
from gateway.viewer.sources import StereoImages, StereoRig
from gateway.wiring import view
from renderers.drawlist import AlphaMode, Image, Material, Mesh, Texture
from tests.support.waiting import SECONDS

WEB = Path(__file__).parents[2] / "gateway" / "viewer" / "web"
COMPILER = WEB / "node_modules" / "typescript" / "bin" / "tsc"
NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(
    NODE is None or not COMPILER.is_file(), reason="TypeScript is not installed (npm ci in gateway/viewer/web)"
)

TEXTURE = Texture(
    Image(b"key", lambda: np.zeros((1, 1, 4), np.uint8)), uv_set=1, uv_transform=(2.0, 0.0, 0.5, 0.0, 3.0, 0.25)
)
MATERIAL = Material(
    (1.0, 0.0, 0.0, 0.5),
    base_color_texture=TEXTURE,
    metallic=0.5,
    roughness=0.5,
    metallic_roughness_texture=TEXTURE,
    normal_texture=TEXTURE,
    normal_scale=0.5,
    occlusion_texture=TEXTURE,
    occlusion_strength=0.25,
    emissive=(0.0, 0.5, 1.0),
    emissive_texture=TEXTURE,
    emissive_strength=3.0,
    alpha_mode=AlphaMode.MASK,
    alpha_cutoff=0.25,
    double_sided=True,
    unlit=True,
    point_size=3.0,
    line_width=2.0,
)
"""A material none of whose properties has its default."""
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
MESH = Mesh(
    CORNERS,
    np.array([[0, 2, 1]], np.uint32),
    normals=np.ones((3, 3), np.float32),
    uv0=CORNERS[:, :2].copy(),
    uv1=CORNERS[:, :2].copy(),
    colors=np.ones((3, 4), np.float32),
)
RIG = StereoRig(np.eye(4), 64, 48, 50.0, 50.0, 32.0, 24.0, 0.16)


class Stereo:
    """A stereo camera without images."""

    def rig(self, snapshot: Snapshot) -> StereoRig | None:
        return RIG

    async def capture(self) -> StereoImages:
        raise NotImplementedError


def fill(tree: LiveTree) -> None:
    """Publish nodes, parts and matrices of every sort."""
    moved, infinite = np.diag([2.0, 1.0, 1.0, 1.0]), np.full((4, 4), np.inf)
    with tree.edit() as edit:
        edit.set_parts(("surface",), (Part(Surface(MESH), MATERIAL, moved), Part(Box((1, 1, 1)), Material(), infinite)))
        edit.set_parts(("surface", 7), (Part(Surface(MESH), Material(alpha_mode=AlphaMode.BLEND), kind="text"),))
        cloud = PointCloud(CORNERS, {"intensity": np.ones(3, np.float32)})
        edit.set_parts(("cloud",), (Part(cloud, Material(), source="scan.ply"),))
        edit.set_visible(("cloud",), False)
        edit.set_opacity(("cloud",), 0.5)
        edit.set_matrix(("cloud",), np.diag([1.0, 2.0, 1.0, 1.0]))
        edit.set_pose(("surface",), (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))


async def headers() -> AsyncIterator[dict[str, Any]]:
    """Yield the headers of all messages for a page that sees a scene, and then its end."""
    context = create_app(Settings()).state.context
    context.registry.fail("treeviewer", "no route")
    context.registry.ready("render")
    context.registry.warn("render", "robot.urdf", "a mesh is missing")
    context.registry.ready("stereo", figures=lambda: {"clients": 2})
    context.registry.ready("drakeviewer", figures=lambda: {"simulation_seconds": 1.5})
    page = LivePage()
    home = LookAtCamera((1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    page.change_view({"background": (0.0, 0.5, 1.0), "grid": False, "home": home})
    page.clicks.subscribe("client", [("surface", 7)], lambda click: None)
    tree = LiveTree()
    hub = ViewHub(ViewerConfig(), tree, status=lambda: view.gateway_status(context), stereo=Stereo(), page=page)
    fill(tree)
    running = asyncio.create_task(hub.run())
    await asyncio.sleep(0)
    browser = hub.connect()
    yield parse_frame(encode_stereo_rig(None))[0]
    try:
        async for frame in browser.frames():
            header = parse_frame(frame)[0]
            yield header
            if header["kind"] != "update":
                continue
            if tree.snapshot.root.children:
                with tree.edit() as edit:
                    edit.delete(())
                gc.collect()
            browser.acknowledge()
    finally:
        running.cancel()
        browser.close()
        await context.close()


KINDS = {
    "update": "Update",
    "mesh": "Wire<MeshPayload>",
    "forget": "Forget",
    "status": "Status",
    "rig": "Rig",
    "page": "PageSettings",
}
"""Types of messages in protocol.ts by their kind."""
DECLARATIONS = """
type Span = [number, number];
/** A message on the wire: the parser replaces positions of arrays by arrays. */
type Wire<T> = { [K in keyof T]: NonNullable<T[K]> extends ArrayBufferView ? Span : T[K] };
type Arrays = "poseIds" | "poses" | "matrixIds" | "matrices";
type Lists = "removed" | "nodes";
interface Transforms { ids: Span; values: Span }
type Update = Omit<SceneUpdate, Arrays | Lists> &
  Partial<Pick<SceneUpdate, Lists>> & { poses?: Transforms; matrices?: Transforms };
type KeysOfAll<T> = T extends unknown ? keyof T : never;
type Unsent<T, Sent> = Exclude<KeysOfAll<T>, KeysOfAll<Sent>>;
"""


async def collect() -> dict[str, list[Any]]:
    """Return values by the name of their type in protocol.ts."""
    found: dict[str, list[Any]] = {kind: [] for kind in KINDS.values()}
    async with asyncio.timeout(SECONDS):
        async for header in headers():
            found[KINDS[header["kind"]]].append(header)
            if all(found.values()) and any("removed" in each for each in found["Update"]):
                break
    nodes = [node for update in found["Update"] for node in update.get("nodes", ())]
    parts = [part for node in nodes for part in node.get("parts") or ()]
    draws = [draw for part in parts for draw in part["draws"]]
    materials = [draw["material"] for draw in draws]
    textures = [value for material in materials for name, value in material.items() if name.lower().endswith("texture")]
    interfaces = [each for status in found["Status"] for each in status["interfaces"].values()]
    click = dict.fromkeys(_Click.__struct_fields__, 0) | {"point": [0, 0, 0]}
    clicks = [{**click, "button": each} for each in get_args(Button)]
    return {
        **found,
        "NodeUpdate": nodes,
        "Part": parts,
        "Draw": draws,
        "Material": materials,
        "TextureUse": textures,
        "InterfaceState": interfaces,
        "Click": clicks,
    }


@pytest.fixture(scope="module")
def sent() -> dict[str, list[Any]]:
    with np.errstate(invalid="ignore"):  # of the infinite matrix
        return asyncio.run(collect())


def compile_messages(sent: dict[str, list[Any]], protocol: str, folder: Path) -> str:
    """Return the compiler's errors for messages as values of the types of a protocol."""
    (folder / "protocol.ts").write_text(protocol)
    names = (
        "Click, Draw, Forget, InterfaceState, Material, MeshPayload, NodeUpdate, PageSettings, Part, Rig, SceneUpdate"
    )
    lines = [f'import type {{ {names}, Status, TextureUse }} from "./protocol";', DECLARATIONS]
    for number, (type_name, values) in enumerate(sent.items()):
        lines.append(f"const sent{number} = {json.dumps(values)} satisfies {type_name}[];")
        lines.append(f"export type All{number} = Assert<Unsent<{type_name}, (typeof sent{number})[number]>>;")
    lines.append("type Assert<T extends never> = T;")
    (folder / "messages.ts").write_text("\n".join(lines))
    options = ("--noEmit", "--strict", "--target", "es2022", "--lib", "es2022,dom")
    command = (str(NODE), str(COMPILER), *options, str(folder / "messages.ts"))
    return subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False).stdout


def test_messages_have_the_types_of_the_page(sent: dict[str, list[Any]], tmp_path: Path) -> None:
    assert compile_messages(sent, (WEB / "src" / "protocol.ts").read_text(), tmp_path) == ""


@pytest.mark.parametrize(
    ("line", "other", "error"),
    [
        ("  roughness?: number;\n", "", "'\"roughness\"' does not exist"),
        ("  mesh: number;\n", "  mesh: number;\n  layer: number;\n", "'layer' is missing"),
        ("  source?: string;\n", "  source?: string;\n  author?: string;\n", '"author"'),
        ("  baseline: number;\n", "  baseline: string;\n", "'number' is not assignable to type 'string'"),
        ('"left" | "middle" | "right"', '"left" | "right"', '"middle"'),
    ],
)
def test_a_different_type_is_an_error(
    sent: dict[str, list[Any]], tmp_path: Path, line: str, other: str, error: str
) -> None:
    protocol = (WEB / "src" / "protocol.ts").read_text()
    assert line in protocol
    assert error in compile_messages(sent, protocol.replace(line, other), tmp_path)
