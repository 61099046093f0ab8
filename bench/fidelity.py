"""Our pictures beside those of other engines: the scenarios of KhronosGroup/glTF-Render-Fidelity.

    SCENEGATE_FIDELITY=CHECKOUT python -m bench.fidelity [--pictures FOLDER] [SCENARIO ...]

CHECKOUT is a recursive clone; of its submodule glTF-Render-Fidelity-Generator the scenarios (``test/config.json``),
the HDR pictures (``environments``) and the models (``glTF-Sample-Assets``) are read, of the site itself the engines'
pictures (``public/thumbnails/goldens``, 512 pixels wide). Nothing of it is part of this repository. Every scenario is
drawn as the suite's viewers draw it: vertical field of view 45 degrees, the camera on its orbit, the HDR picture as the
only light beside the file's own, ACES tone mapping, twice the scenario's size, made smaller as the site makes its
thumbnails.

Distances are taken inside both silhouettes, a pixel away from borders, in units of 1/255 (mean over the channels) and
in the suite's own measure: ``10 log10(rms(YIQ distance) / 35215)`` dB. "Others" are the distances between the engine of
that line and each other engine. We lie near an engine when our distance is not beyond what the engine farthest from it
has; the last column counts the engines that lie farther from it than we do.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gateway.files.assets.scene_file import SceneFileError, read_scene_file
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.transforms import Y_UP_TO_Z_UP
from renderers.camera import OPENGL_FROM_OPTICAL, Camera
from renderers.color import linear_from_srgb
from renderers.drawlist import LABEL_NONE, AlphaMode
from renderers.interface import Look, Output
from renderers.light_rig import Rig, Surroundings
from renderers.raster import CpuRenderer

ENVIRONMENT: Final = "SCENEGATE_FIDELITY"
GENERATOR: Final = "glTF-Render-Fidelity-Generator"
DEFAULTS: Final[dict[str, Any]] = {
    "lighting": "environments/lightroom_14b.hdr",
    "dimensions": {"width": 768, "height": 768},
    "target": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orbit": {"theta": 0.0, "phi": 90.0, "radius": 1.0},
    "verticalFoV": 45.0,
    "renderSkybox": False,
}
"""Default values of the suite's configuration files."""
DENSITY: Final = 2
"""Pixels of the engines' pictures to one of the scenario's."""
LARGEST: Final = 35215.0
"""The largest YIQ distance (Kotsarenko and Ramos 2010)."""

LINEAR: Final = np.array([linear_from_srgb(level / 255.0) for level in range(256)])
"""Linear value of each 8-bit sRGB value, (256,) float64."""

Picture = NDArray[np.float64]
"""(H, W, 4): straight RGB and coverage, 0 .. 255."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """One model under one camera."""

    name: str
    model: Path
    lighting: Path
    width: int
    height: int
    target: tuple[float, float, float]
    theta: float
    phi: float
    radius: float
    fov: float
    """Vertical, degrees."""
    goldens: dict[str, Path]
    """The engines' pictures."""

    @property
    def camera(self) -> Camera:
        """The scenario's camera at the engines' image size, in our Z-up world."""
        theta, phi = math.radians(self.theta), math.radians(self.phi)
        back = np.array((math.sin(phi) * math.sin(theta), math.cos(phi), math.sin(phi) * math.cos(theta)))
        right = np.array((math.cos(theta), 0.0, -math.sin(theta)))
        X = np.eye(4)
        X[:3, 0], X[:3, 1], X[:3, 2] = right, np.cross(back, right), back
        X[:3, 3] = np.array(self.target) + self.radius * back
        w, h = DENSITY * self.width, DENSITY * self.height
        focal = h / 2 / math.tan(math.radians(self.fov) / 2)
        X = Y_UP_TO_Z_UP @ X @ OPENGL_FROM_OPTICAL
        return Camera(w, h, focal, focal, w / 2, h / 2, 2e-3 * self.radius, math.inf, X)


def _below(root: Path, uri: str) -> Path:
    """A path of the configuration, which is written from a folder three levels down."""
    return root.joinpath(*(part for part in Path(uri).parts if part != ".."))


def scenarios(checkout: Path) -> tuple[list[Scenario], dict[str, str]]:
    """Those that can be drawn and compared, and why the others cannot.

    Raises:
        OSError: the checkout has no configuration.
    """
    root = checkout / GENERATOR
    found: list[Scenario] = []
    without: dict[str, str] = {}
    for written in json.loads((root / "test" / "config.json").read_text("utf-8"))["scenarios"]:
        values: dict[str, Any] = {
            key: {**v, **written.get(key, {})} if isinstance(v, dict) else v for key, v in DEFAULTS.items()
        }
        values |= {key: v for key, v in written.items() if not isinstance(v, dict)}
        name: str = values["name"]
        model, lighting = _below(root, values["model"]), _below(root, values["lighting"])
        folder = checkout / "public" / "thumbnails" / "goldens" / name
        goldens = {path.name.partition("-golden")[0]: path for path in sorted(folder.glob("*-golden.thumb.webp"))}
        if values["renderSkybox"]:
            without[name] = "its pictures show the sky and have no silhouette"
        elif not model.is_file() or not lighting.is_file():
            without[name] = f"{(lighting if model.is_file() else model).name} is not in the checkout"
        elif len(goldens) < 3:
            without[name] = f"pictures of {len(goldens)} engines are too few"
        else:
            size, target, orbit = values["dimensions"], values["target"], values["orbit"]
            found.append(
                Scenario(
                    name,
                    model,
                    lighting,
                    size["width"],
                    size["height"],
                    (target["x"], target["y"], target["z"]),
                    orbit["theta"],
                    orbit["phi"],
                    orbit["radius"],
                    values["verticalFoV"],
                    goldens,
                )
            )
    return found, without


def draw(scenario: Scenario, renderer: CpuRenderer, shape: tuple[int, int]) -> Picture:
    """Our picture, made as small as ``shape`` (rows, columns).

    Raises:
        SceneFileError: the model cannot be read.
    """
    file = read_scene_file(scenario.model)
    rig = Rig(surroundings=Surroundings(image=scenario.lighting.read_bytes()), tone="aces", shadow_size=0)
    scene = replace(flatten(file.root, label_of=lambda _path, _part: 1), lights=file.lights)
    black, white = Look("studio", (0, 0, 0), rig=rig), Look("studio", (255, 255, 255), rig=rig)
    frame = renderer.render(scene, scenario.camera, Output.COLOR | Output.LABEL, black)
    assert frame.color is not None
    assert frame.label is not None
    color = frame.color
    seen = np.where(frame.label == LABEL_NONE, 0, 255).astype(np.uint8)
    if any(instance.material.alpha_mode is not AlphaMode.OPAQUE for instance in scene.instances):
        # What the background shines through is seen by a second picture, over white.
        frame = renderer.render(scene, scenario.camera, Output.COLOR, white)
        assert frame.color is not None
        through = LINEAR[frame.color] - LINEAR[color]
        alpha = np.clip(1.0 - through.mean(axis=-1, keepdims=True), 0.0, 1.0)
        straight = np.minimum(LINEAR[color] / np.maximum(alpha, 1e-6), 1.0)
        color = np.searchsorted((LINEAR[1:] + LINEAR[:-1]) / 2, straight).astype(np.uint8)
        seen = (255.0 * alpha[..., 0]).round().astype(np.uint8)
    full = np.dstack((color, seen))
    # Pillow weighs colours by alpha while it makes a picture smaller, as the site's sharp does.
    small = Image.fromarray(full, "RGBA").resize(shape[::-1], Image.Resampling.LANCZOS)
    return np.asarray(small, np.float64)


def golden(path: Path) -> Picture:
    """An engine's picture."""
    return np.asarray(Image.open(path).convert("RGBA"), np.float64)


def inner(*pictures: Picture) -> NDArray[np.bool_]:
    """(H, W): what all pictures cover, and all pixels around it."""
    covered = np.logical_and.reduce([picture[..., 3] >= 254.0 for picture in pictures])
    result: NDArray[np.bool_] = covered.copy()
    for axis, step in itertools.product((0, 1), (1, -1)):
        result &= np.roll(covered, step, axis)
    return result


def distance(a: Picture, b: Picture) -> tuple[float, float]:
    """Mean absolute difference in 1/255 and the suite's decibels, inside both silhouettes."""
    where = inner(a, b)
    if not where.any():
        return math.nan, math.nan
    off = a[where][:, :3] - b[where][:, :3]
    yiq = (
        off
        @ np.array(
            (
                (0.29889531, 0.58662247, 0.11448223),
                (0.59597799, -0.27417610, -0.32180189),
                (0.21147017, -0.52261711, 0.31114694),
            )
        ).T
    )
    delta = (yiq * yiq) @ np.array((0.5053, 0.299, 0.1957))
    rms = math.sqrt(float((delta * delta).mean())) / LARGEST
    return float(np.abs(off).mean()), 10.0 * math.log10(max(rms, 1e-9))


def silhouette(a: Picture, b: Picture) -> float:
    """Pixels that only one of two covers by more than half, over those that b covers."""
    one, other = a[..., 3] >= 127.5, b[..., 3] >= 127.5
    return float((one != other).sum()) / max(float(other.sum()), 1.0)


@dataclass(frozen=True, slots=True)
class Line:
    """Comparison of one engine's image with all others, for one scenario."""

    scenario: str
    engine: str
    ours: float
    """1/255."""
    others: tuple[float, ...]
    """1/255: from this engine to each other one, ascending."""
    ours_db: float
    others_db: tuple[float, ...]
    silhouette: float
    others_silhouette: tuple[float, ...]

    @property
    def near(self) -> bool:
        """True if at least one other engine differs as much from this one as we do."""
        return self.ours <= self.others[-1]

    @property
    def farther(self) -> int:
        """Number of engines that differ more from this one than we do."""
        return sum(other >= self.ours for other in self.others)


def compare(name: str, ours: Picture, goldens: dict[str, Picture]) -> list[Line]:
    """One line for each engine whose picture has a silhouette."""
    usable = {engine: picture for engine, picture in goldens.items() if inner(picture).any()}
    between = {
        frozenset(pair): (*distance(usable[pair[0]], usable[pair[1]]), silhouette(usable[pair[0]], usable[pair[1]]))
        for pair in itertools.combinations(usable, 2)
    }
    lines = []
    for engine, picture in usable.items():
        others = [between[frozenset((engine, other))] for other in usable if other != engine]
        means, decibels, outlines = (tuple(sorted(column)) for column in zip(*others, strict=True))
        own, own_db = distance(ours, picture)
        lines.append(Line(name, engine, own, means, own_db, decibels, silhouette(ours, picture), outlines))
    return lines


def measure(scenario: Scenario, renderer: CpuRenderer) -> tuple[list[Line], Picture, dict[str, Picture]]:
    """Draws and compares; with the pictures."""
    goldens = {engine: golden(path) for engine, path in scenario.goldens.items()}
    shape = next(iter(goldens.values())).shape[:2]
    goldens = {engine: picture for engine, picture in goldens.items() if picture.shape[:2] == shape}
    ours = draw(scenario, renderer, (shape[0], shape[1]))
    return compare(scenario.name, ours, goldens), ours, goldens


def sheet(ours: Picture, goldens: dict[str, Picture]) -> Image.Image:
    """All pictures side by side over white, ours first, below each the difference to ours, six times as strong."""

    def white(p: Picture) -> Picture:
        return p[..., :3] * (p[..., 3:] / 255.0) + 255.0 - p[..., 3:]

    shown = {"scenegate": ours, **goldens}
    top = np.hstack([white(p) for p in shown.values()])
    below = np.hstack([np.clip(128.0 + 6.0 * (white(p) - white(ours)), 0.0, 255.0) for p in shown.values()])
    return Image.fromarray(np.vstack((top, below)).round().astype(np.uint8))


@dataclass(frozen=True, slots=True)
class Summary:
    """Comparison of our image with all engines, for one scenario."""

    scenario: str
    engines: int
    ours: float
    """1/255: median over the engines."""
    others: float
    """1/255: median over all pairs of engines."""
    near: int
    """Engines that we lie near."""
    silhouette: float
    """Least over the engines: those that cut their own pictures otherwise do not count."""


def summaries(lines: Sequence[Line]) -> list[Summary]:
    """One for each scenario."""
    found = []
    for name, group in itertools.groupby(lines, lambda line: line.scenario):
        own = list(group)
        pairs = [other for line in own for other in line.others]  # each twice
        found.append(
            Summary(
                name,
                len(own),
                float(np.median([line.ours for line in own])),
                float(np.median(pairs)),
                sum(line.near for line in own),
                min(line.silhouette for line in own),
            )
        )
    return found


def summary_table(found: Sequence[Summary]) -> str:
    """Return a Markdown table."""
    head = (
        "| scenario | engines | ours to them, median 1/255 | they to one another | near | silhouette |\n"
        "|---|---|---|---|---|---|\n"
    )
    return head + "\n".join(
        f"| {each.scenario.removeprefix('khronos-')} | {each.engines} | {each.ours:.2f} | {each.others:.2f} "
        f"| {each.near} of {each.engines} | {each.silhouette:.2%} |"
        for each in found
    )


def table(lines: Sequence[Line]) -> str:
    """Return a Markdown table."""
    head = (
        "| scenario | engine | ours, 1/255 | others: least .. median .. most | ours, dB | others, dB "
        "| silhouette | others | engines farther |\n|---|---|---|---|---|---|---|---|---|\n"
    )
    rows = []
    for line in lines:
        middle, middle_db = (float(np.median(values)) for values in (line.others, line.others_db))
        rows.append(
            f"| {line.scenario.removeprefix('khronos-')} | {line.engine} | {line.ours:.2f} "
            f"| {line.others[0]:.2f} .. {middle:.2f} .. {line.others[-1]:.2f} | {line.ours_db:.1f} "
            f"| {line.others_db[0]:.1f} .. {middle_db:.1f} .. {line.others_db[-1]:.1f} | {line.silhouette:.2%} "
            f"| {line.others_silhouette[0]:.2%} .. {line.others_silhouette[-1]:.2%} "
            f"| {line.farther} of {len(line.others)}{'' if line.near else ' **far**'} |"
        )
    return head + "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--pictures", type=Path, help="a folder for our pictures beside the engines'")
    parser.add_argument("scenario", nargs="*", help="names, with or without khronos-; default: all that can be drawn")
    args = parser.parse_args()
    checkout = os.environ.get(ENVIRONMENT)
    if not checkout:
        sys.exit(f"{ENVIRONMENT} names no checkout of KhronosGroup/glTF-Render-Fidelity")
    found, without = scenarios(Path(checkout))
    wanted = {name.removeprefix("khronos-") for name in args.scenario}
    renderer = CpuRenderer()
    lines: list[Line] = []
    for scenario in found:
        if wanted and scenario.name.removeprefix("khronos-") not in wanted:
            continue
        try:
            measured, ours, goldens = measure(scenario, renderer)
        except SceneFileError as error:
            without[scenario.name] = str(error)
            continue
        lines += measured
        print(f"{scenario.name}: {len(measured)} engines", file=sys.stderr, flush=True)
        if args.pictures:
            args.pictures.mkdir(parents=True, exist_ok=True)
            sheet(ours, goldens).save(args.pictures / f"{scenario.name}.png")
    print(table(lines), end="\n\n")
    print(summary_table(summaries(lines)))
    for name, reason in without.items():
        if not wanted or name.removeprefix("khronos-") in wanted:
            print(f"not compared: {name}: {reason}")


if __name__ == "__main__":
    main()
