"""Find and read the recorded requests of real clients.

``SCENEGATE_CORPUS`` names a folder with ``drake/`` (render requests) and ``treeviewer/``. The recordings are no part of
the project; tests that need them are marked ``corpus`` and skip, with a reason, where they are absent.
"""

import json
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

ENVIRONMENT = "SCENEGATE_CORPUS"
IMAGE_TYPES = ("color", "depth", "label")
EMPTY_LABEL = 32766
"""The background of the reference labels (RenderLabel::kEmpty), which no server can answer."""
DONT_CARE_LABEL = 32764
"""Label that the client makes of a white pixel (RenderLabel::kDontCare)."""


def corpus_path() -> Path | None:
    """The folder, or None when there is none."""
    value = os.environ.get(ENVIRONMENT)
    path = Path(value) if value else None
    return path if path is not None and path.is_dir() else None


def corpus_dir() -> Path:
    """The folder; skips the calling test when there is none."""
    path = corpus_path()
    if path is None:
        pytest.skip(f"{ENVIRONMENT} does not name a folder with recorded requests")
    return path


@dataclass(frozen=True)
class Recorded:
    """One request as it came over the wire."""

    path: Path
    """Folder of the recording."""

    @property
    def body(self) -> bytes:
        return (self.path / "request.multipart").read_bytes()

    @property
    def headers(self) -> list[tuple[str, str]]:
        """In order, as recorded."""
        recorded: dict[str, Any] = json.loads((self.path / "headers.json").read_text())
        return [(name, value) for name, value in recorded["headers"]]

    @property
    def content_type(self) -> str:
        return next(value for name, value in self.headers if name.lower() == "content-type")

    @property
    def fields(self) -> dict[str, str]:
        """The text fields of the form."""
        recorded: dict[str, dict[str, str]] = json.loads((self.path / "fields.json").read_text())
        return recorded["fields"]

    @property
    def scene(self) -> bytes:
        """The glTF file, cut out of the body by hand: the last part."""
        boundary = self.content_type.rpartition("boundary=")[2].encode()
        last = self.body.rindex(b'name="scene";')
        start = self.body.index(b"\r\n\r\n", last) + 4
        return self.body[start : self.body.rindex(b"\r\n--" + boundary)]


@dataclass(frozen=True)
class DrakeScene:
    """A scene with its three requests and RenderEngineVtk's answers."""

    path: Path
    name: str
    version: str
    """Version of the client: ``scenes`` was recorded from 1.58.0; the other folder names its own."""
    expect: str
    """From index.json: ``match``, or in words what is different."""

    def __str__(self) -> str:
        return self.name if self.version == "scenes" else f"{self.name}@{self.version.removeprefix('scenes_')}"

    def request(self, image_type: str) -> Recorded:
        return Recorded(self.path / image_type)

    def reference_color(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB."""
        bgr = cv2.imread(str(self.path / "reference_color.png"), cv2.IMREAD_COLOR)
        assert bgr is not None
        return np.ascontiguousarray(bgr[..., ::-1]).astype(np.uint8)

    def reference_depth(self) -> NDArray[np.float32]:
        """(H, W) metres; 0 too close, inf too far."""
        with np.load(self.path / "reference_depth.npz") as arrays:
            return np.asarray(arrays["depth"], dtype=np.float32)

    def reference_label(self) -> NDArray[np.int32]:
        """(H, W), with the background as a server must answer it."""
        with np.load(self.path / "reference_label.npz") as arrays:
            label = np.asarray(arrays["label"], dtype=np.int32)
        return np.where(label == EMPTY_LABEL, DONT_CARE_LABEL, label)


@cache
def drake_scenes() -> tuple[DrakeScene, ...]:
    """All recorded scenes, () without a corpus; a folder of another version inherits the expectation of the name."""
    root = corpus_path()
    if root is None:
        return ()
    index: list[dict[str, Any]] = json.loads((root / "drake" / "index.json").read_text())
    expect = {entry["name"]: entry["expect"] for entry in index}
    return tuple(
        DrakeScene(path, path.name, folder.name, expect[path.name])
        for folder in sorted((root / "drake").glob("scenes*"))
        for path in sorted(folder.iterdir())
        if path.is_dir()
    )


def drake_scene(name: str, version: str = "scenes") -> DrakeScene:
    """The scene; skips the calling test when there is no corpus."""
    corpus_dir()
    return next(scene for scene in drake_scenes() if scene.name == name and scene.version == version)


def decode_label(rgb: NDArray[np.uint8]) -> NDArray[np.int32]:
    """(H, W, 3) -> labels as Drake's client reads them: white is kDontCare, else red + 256 green; blue is ignored."""
    wide = rgb.astype(np.int32)
    return np.where((wide == 255).all(axis=-1), DONT_CARE_LABEL, wide[..., 0] | wide[..., 1] << 8)
