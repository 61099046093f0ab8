"""Reading glTF: our reader against trimesh, in one run: rounds in which each reads the document ten times in a row, as
frames are drawn in other benches, so that caches are warm. The order is random, so that none always comes after the
same other one. The first of each ten, which finds the caches full of another program's code and data, is told apart.

    python -m bench.gltf [FOLDER]

First what Drake's client sends. FOLDER holds recorded requests (default: the environment's SCENEGATE_CORPUS); without
one, a scene is made up. Columns, medians in CPU ms of one thread: ``cold`` nothing known, ``meshes`` the buffers known
but something else in the text different (new materials), ``moved`` only the nodes different, as while a robot moves;
``trimesh`` its scenes with what a renderer needs and our reader always makes: materials with their textures, and vertex
normals where the document has none, by a few lines of numpy (trimesh's own need SciPy and take longer). The goal is
about these equal results; docs/decisions/0004-content-addressing.md says why it is no higher. Two columns beside it
make less: ``arrays`` is trimesh's parser alone, neither a tree nor meshes nor materials, and ``bare`` its scenes
without materials, normals as far as the document has them.

None decodes images: ours looks at their headers, and so does Pillow, which trimesh opens them with and which decodes
when pixels are asked for. The bench counts that, and ends with an error if trimesh's peer decoded one.

Then files as modelling tools write them (``gltf_files``), of which nothing is known. They have normals, so that
trimesh's scene with materials is all that there is to do.
"""

import base64
import io
import json
import os
import statistics
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import PIL.Image
import PIL.ImageFile
import trimesh
import trimesh.exchange.gltf

from bench import gltf_files
from bench.render_requests import scene_of
from bench.table import Row, at_least, geometric_mean, heading, show
from bench.turns import TURN, in_turns, timed
from gateway.files.gltf import GltfCache, read_gltf
from gateway.runtime.workers.process_tuning import freeze_gc, tune
from renderers.compiler.jit import compile_all

RUNS = 4 * TURN


def made_up(meshes: int, vertices: int) -> bytes:
    """A scene as VTK's exporter writes it: a buffer for every accessor."""
    rng = np.random.default_rng(0)
    document: dict[str, Any] = {
        key: [] for key in ("accessors", "bufferViews", "buffers", "materials", "meshes", "nodes")
    }
    document |= {"asset": {"version": "2.0", "generator": "VTK"}, "scene": 0, "scenes": [{"nodes": [*range(meshes)]}]}
    document["materials"] = [{"pbrMetallicRoughness": {"roughnessFactor": 1.0}}]

    def accessor(values: np.ndarray[Any, Any], component: int, kind: str) -> int:
        data = values.tobytes()
        uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        index = len(document["buffers"])
        document["buffers"].append({"byteLength": len(data), "uri": uri})
        document["bufferViews"].append({"buffer": index, "byteLength": len(data)})
        view = {"bufferView": index, "componentType": component, "count": len(values), "type": kind}
        document["accessors"].append(view)
        return index

    for mesh in range(meshes):
        position = accessor(rng.random((vertices, 3), np.float32), 5126, "VEC3")
        indices = accessor(rng.integers(0, vertices, 6 * vertices, dtype=np.uint32), 5125, "SCALAR")
        primitive = {"attributes": {"POSITION": position}, "indices": indices, "material": 0}
        document["meshes"].append({"primitives": [primitive]})
        document["nodes"].append({"mesh": mesh, "name": f"g{mesh}", "translation": [mesh, 0.0, 0.0]})
    return json.dumps(document).encode()


def recorded(folder: Path) -> Iterator[tuple[str, bytes]]:
    """The glTF parts of the recorded colour requests."""
    for request in sorted(folder.glob("drake/scenes/*/color/request.multipart")):
        yield request.parent.parent.name, scene_of(request.read_bytes())


def parsed(data: bytes, kind: str = "gltf") -> object:
    """Arrays alone."""
    parser = {"glb": trimesh.exchange.gltf.load_glb, "gltf": trimesh.exchange.gltf.load_gltf}[kind]
    return parser(io.BytesIO(data), skip_materials=True)


def bare_scene(data: bytes, kind: str = "gltf") -> Any:
    """A tree of meshes, normals as far as the document has them; no materials."""
    return trimesh.load_scene(io.BytesIO(data), file_type=kind, process=False, skip_materials=True)


def trimesh_scene(data: bytes, kind: str = "gltf") -> Any:
    """The same with materials and their textures."""
    return trimesh.load_scene(io.BytesIO(data), file_type=kind, process=False, skip_materials=False)


def trimesh_with_normals(data: bytes, *, missing: bool) -> None:
    """And with a normal at every vertex; ``missing``: the document has none."""
    for mesh in trimesh_scene(data).geometry.values():
        if not missing or not hasattr(mesh, "faces"):
            continue
        faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices)
        a, b, c = (vertices[faces[:, corner]] for corner in range(3))
        crosses = np.cross(b - a, c - a)
        normals = np.zeros_like(vertices)
        for corner in range(3):
            np.add.at(normals, faces[:, corner], crosses)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def check_pictures(name: str, data: bytes, kind: str = "gltf") -> int:
    """Check that the peer opens images as ours does, without decoding them; return the number of images opened.

    Raises:
        SystemExit: the peer decoded an image, or Pillow did not recognise one and tried every format.
    """
    opened: list[str | None] = []
    open_picture = PIL.Image.open

    def opening(*given: Any, **named: Any) -> PIL.Image.Image:
        opened.append(None)
        picture = open_picture(*given, **named)
        opened[-1] = picture.format
        return picture

    with (
        patch.object(PIL.ImageFile.ImageFile, "load", autospec=True) as decoded,
        patch.object(PIL.Image, "open", opening),
    ):
        trimesh_scene(data, kind)
    if decoded.called or not all(opened):
        raise SystemExit(f"{name}: trimesh opened pictures as {opened} and decoded {decoded.call_count}")
    return len(opened)


@dataclass(frozen=True, slots=True)
class Times:
    """Times of reading a document, ms."""

    median: float
    first: float
    """The median of those that came after another reader."""


def times_of(works: Sequence[Sequence[Callable[[], object]]]) -> tuple[Times, ...]:
    """Measure contestants, each given as one call a run, in turns of ``TURN`` runs."""
    calls = {str(place): lambda run, work=work: timed(work[run]) for place, work in enumerate(works)}
    cpu = [[each.cpu for each in times] for times in in_turns(calls, RUNS, warm=0).values()]
    return tuple([Times(statistics.median(of), statistics.median(of[::TURN])) for of in cpu])


def ratio_of_firsts(ours: Iterable[Times], theirs: Iterable[Times]) -> float:
    """Geometric mean."""
    return geometric_mean([b.first / a.first for a, b in zip(ours, theirs, strict=True)])


def read_cold(data: bytes) -> object:
    """By ours, with nothing known."""
    return read_gltf(data, cache=GltfCache(), posted=True)


def variants(data: bytes) -> tuple[list[bytes], list[bytes]]:
    """The document with other materials, and with other nodes; members sorted by name as the client writes them."""
    document = {key: value for key, value in json.loads(data).items() if value is not None}
    materials, nodes = [], []
    for run in range(RUNS + 3):
        document["materials"][0]["name"] = f"run {run}"
        materials.append(json.dumps(document, separators=(",", ":"), sort_keys=True).encode())
    for run in range(RUNS + 3):
        document["nodes"][0]["name"] = f"run {run}"
        nodes.append(json.dumps(document, separators=(",", ":"), sort_keys=True).encode())
    return materials, nodes


def of_requests() -> list[Row]:
    """Prints the table of all scenes; gives the geometric means."""
    corpus = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("SCENEGATE_CORPUS")
    scenes = list(recorded(Path(corpus))) if corpus else []
    scenes += [("40 meshes, 800k vertices", made_up(40, 20_000)), ("500 boxes", made_up(500, 24))]
    found_times: list[tuple[Times, ...]] = []
    times_heads = ("cold, ms", "meshes", "moved", "arrays", "bare", "trimesh")
    print("\n" + heading("scene", "MB", *times_heads, "trimesh / cold", "/ meshes", "/ moved"))
    for name, data in scenes:
        materials, nodes = variants(data)
        missing = b'"NORMAL"' not in data
        check_pictures(name, nodes[0])
        known, moving = GltfCache(), GltfCache()
        read_gltf(data, cache=known, posted=True)
        for text in nodes[:3]:
            read_gltf(text, cache=moving, posted=True)
        times = times_of(
            (
                [partial(read_cold, data)] * RUNS,
                [partial(read_gltf, text, cache=known) for text in materials[3:]],
                [partial(read_gltf, text, cache=moving) for text in nodes[3:]],
                [partial(parsed, text) for text in nodes[3:]],
                [partial(bare_scene, text) for text in nodes[3:]],
                [partial(trimesh_with_normals, text, missing=missing) for text in nodes[3:]],
            )
        )
        found_times.append(times)
        medians = [of.median for of in times]
        figures = " | ".join(f"{value:.2f}" for value in medians)
        quotients = " | ".join(f"{medians[5] / value:.1f}" for value in medians[:3])
        print(f"| {name} | {len(data) / 1e6:.2f} | {figures} | {quotients} |", flush=True)
    goals = {
        "nothing known before": 2,
        "buffers known, materials new": 3,
        "only the nodes new, as while a robot moves": 8,
    }
    of_each = [*zip(*found_times, strict=True)]
    columns = [[of.median for of in column] for column in of_each]
    peer = geometric_mean(columns[5])
    found = []
    for (what, goal), column, all_times in zip(goals.items(), columns[:3], of_each[:3], strict=True):
        ratios = [theirs / ours for ours, theirs in zip(column, columns[5], strict=True)]
        bare = (
            f"{geometric_mean(columns[at]) / geometric_mean(column):.1f}× {it}"
            for at, it in ((3, "arrays"), (4, "without materials"))
        )
        firsts = f"{ratio_of_firsts(all_times, of_each[5]):.1f}× the first of each ten"
        cell = f"{geometric_mean(column):.2f} ms (least {min(ratios):.1f}×; {firsts}; {', '.join(bare)})"
        name = f"glTF reader, requests of Drake's client, {what} (geometric mean)"
        found.append(
            at_least(name, cell, f"trimesh with materials and normals {peer:.2f} ms", geometric_mean(ratios), goal)
        )
    return found


def of_files() -> Row:
    """Prints the table of the files; gives the geometric mean."""
    found_times: list[tuple[Times, ...]] = []
    print("\n" + heading("file", "MB", "cold, ms", "arrays", "bare", "trimesh", "trimesh / cold"))
    for name, kind, data in gltf_files.files():
        check_pictures(name, data, kind)
        works = (partial(read_cold, data), *(partial(work, data, kind) for work in (parsed, bare_scene, trimesh_scene)))
        times = times_of([[work] * RUNS for work in works])
        found_times.append(times)
        medians = [of.median for of in times]
        figures = " | ".join(f"{value:.2f}" for value in medians)
        print(f"| {name} | {len(data) / 1e6:.2f} | {figures} | {medians[3] / medians[0]:.1f} |", flush=True)
    of_each = [*zip(*found_times, strict=True)]
    cold, arrays, bare, peer = (geometric_mean([of.median for of in column]) for column in of_each)
    ratios = [theirs.median / ours.median for ours, _, _, theirs in found_times]
    firsts = f"{ratio_of_firsts(of_each[0], of_each[3]):.1f}× the first of each ten"
    least, more = min(ratios), f"{firsts}; {arrays / cold:.1f}× arrays, {bare / cold:.1f}× without materials"
    cell = f"{cold:.2f} ms (least {least:.1f}×; {more})"
    name = "glTF reader, files as modelling tools write them, nothing known before (geometric mean)"
    return at_least(name, cell, f"trimesh with materials {peer:.2f} ms", geometric_mean(ratios), 8)


def rows() -> list[Row]:
    """Measure requests of Drake's client and files of modelling tools."""
    return [*of_requests(), of_files()]


def main() -> None:
    tune()  # as the server does
    compile_all()
    freeze_gc()
    show(rows())


if __name__ == "__main__":
    main()
