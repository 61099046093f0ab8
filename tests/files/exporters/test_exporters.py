"""Files of other packages are drawn as the two boxes that they were made of, but for what ``exporters.toml`` says."""

import tomllib
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.datasets.rendering import BASE_COLOR_LOOK, unlit
from gateway.files.robots.scene_files import SCENE_SUFFIXES, SceneOptions, read_scene
from gateway.scene.draw.cameras import parse_camera
from gateway.scene.draw.flatten import flatten
from gateway.scene.draw.viewpoints import resolve_camera
from gateway.scene.tree.nodes import Node
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer
from tools.exporters.programs import BOXES, corners_of

pytestmark = pytest.mark.slow

FOLDER: Final = Path(__file__).parent
FILES: Final[dict[str, dict[str, Any]]] = {
    file["name"]: file for file in tomllib.loads((FOLDER / "exporters.toml").read_text())["file"]
}
CAMERAS: Final = ("eye=1.5,-2.5,1.5;target=0.3,0,0.4;fovy=40", "eye=-1.5,2,2;target=0.3,0,0.4;fovy=40")


def test_each_file_is_described() -> None:
    assert FILES.keys() == {path.name for path in FOLDER.iterdir() if path.suffix in SCENE_SUFFIXES}


@pytest.fixture(scope="module")
def renderer() -> CpuRenderer:
    return CpuRenderer()


def images(renderer: CpuRenderer, root: Node) -> list[tuple[NDArray[np.uint8], NDArray[np.float32]]]:
    """Return the base colour and depth, in metres, of a scene from each of the cameras."""
    draw_list = flatten(root)
    found = []
    for text in CAMERAS:
        camera = resolve_camera(parse_camera(text), root, 160, 120, near=0.1, far=10.0, draw_list=draw_list)
        frame = renderer.render(unlit(draw_list, Look("studio")), camera, Output.COLOR | Output.DEPTH, BASE_COLOR_LOOK)
        assert frame.color is not None
        assert frame.depth is not None
        found.append((frame.color, frame.depth))
    return found


def boxes(tmp_path: Path, turn: float, colors: list[list[int]]) -> Node:
    """Return the two boxes, turned about the vertical by an angle in degrees."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    lines = []
    for number, (box, color) in enumerate(zip(BOXES, colors, strict=True)):
        rgb = " ".join(f"{channel / 255:.6f}" for channel in color)
        lines += [f"v {c * x - s * y} {s * x + c * y} {z} {rgb}" for x, y, z in corners_of(box)]
        for side in ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)):
            lines.append("f " + " ".join(str(8 * number + corner) for corner in side))
    path = tmp_path / "boxes.obj"
    path.write_text("\n".join(lines))
    return read_scene(path).root


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_drawn_as_the_boxes(name: str, renderer: CpuRenderer, tmp_path: Path) -> None:
    file = FILES[name]
    scene = read_scene(FOLDER / name, SceneOptions(**file.get("reading", {})))
    assert len(scene.warnings) == file.get("warnings", 0), scene.warnings
    drawn = {"turn": 0, "colors": [box["color"] for box in BOXES], **file.get("drawn", {})}
    expected = images(renderer, boxes(tmp_path, **drawn))
    for (color, depth), (expected_color, expected_depth) in zip(images(renderer, scene.root), expected, strict=True):
        differs = (np.abs(color.astype(int) - expected_color) > 2).any(axis=2)
        differs |= ~np.isclose(depth, expected_depth, atol=1e-3)  # inf where nothing is
        assert np.isfinite(expected_depth).sum() > 1000
        assert differs.sum() <= 4, "pixels of the outline"
