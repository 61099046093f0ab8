"""Classes of objects."""

import json
import os
import tomllib
from pathlib import Path

import pytest

from gateway.datasets import classes
from gateway.datasets.classes import classes_of_models, read_classes
from gateway.datasets.errors import DatasetError

FILE = """
[[class]]
name = "mug"
model = ["mug*", "cup"]

[[class]]
name = "robot"
id = 7
path = "panda/*"
file = "cells/*.glb"

[[class]]
name = "mug"
model = "beaker?"

[[class]]
name = "rest"
path = "*"
"""


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_the_first_entry_that_matches(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"classes{suffix}"
    path.write_text(FILE if suffix == ".toml" else json.dumps(tomllib.loads(FILE)))
    table, digest = read_classes(path)
    assert table.names == {"1": "mug", "2": "rest", "7": "robot"}
    assert len(digest) == 64
    for scene, node, model, expected in (
        ("a.glb", ("table", "x"), "mug_01", 1),
        ("a.glb", ("x",), "cup", 1),
        ("a.glb", ("x",), "cups", 2),
        ("a.glb", ("x",), "beaker1", 1),
        ("a.glb", ("x",), "beaker12", 2),
        ("cells/a.glb", ("panda", "link", 3), "l", 7),
        ("cells/a.glb", ("pandas", "link"), "l", 2),
        ("a.glb", ("panda", "link"), "l", 2),
    ):
        assert table.class_of(scene, node, model) == expected


def test_objects_without_a_class(tmp_path: Path) -> None:
    path = tmp_path / "classes.toml"
    path.write_text('[[class]]\nname = "a"\nmodel = "[ab]*"')
    table, _ = read_classes(path)
    assert [table.class_of("s", ("n",), model) for model in ("a", "b1", "c", "A")] == [1, 1, 0, 0]


def test_whole_nodes(tmp_path: Path) -> None:
    path = tmp_path / "classes.toml"
    path.write_text(
        '[[class]]\nname = "a"\nfile = "*.glb"\npath = "x/*"\nwhole = true\n[[class]]\nname = "b"\npath = "*"'
    )
    table, _ = read_classes(path)
    assert [table.is_whole("s.glb", node) for node in (("x",), ("x", "y"), ("x", "y", 3), ("y",))] == [
        False,
        True,
        True,
        False,
    ]
    assert not table.is_whole("s.urdf", ("x", "y"))
    assert not classes_of_models(["a"]).is_whole("s.glb", ("x", "y"))


def test_without_a_file_each_model_is_a_class(monkeypatch: pytest.MonkeyPatch) -> None:
    table = classes_of_models(["b", "a", "b"])
    assert table.names == {"1": "a", "2": "b"}
    assert [table.class_of("s", ("n",), model) for model in ("a", "b", "c")] == [1, 2, 0]
    monkeypatch.setattr(classes, "MAX_CLASSES", 1)
    with pytest.raises(DatasetError, match="2 models are more than 1 classes"):
        classes_of_models(["b", "a"])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "missing required field `class`"),
        ("class = []", "length >= 1"),
        ("[[class", "TOML|Expected"),
        ('[[class]]\nname = "a"', r"class\[0\] \(a\) has none of model, path and file"),
        ('[[class]]\nname = "a"\nmodel = 3', r"`\$\.class\[0\]\.model`|class\[0\]\.model"),
        ('[[class]]\nname = "a"\nmodel = ""', "length >= 1"),
        ('[[class]]\nname = ""\nmodel = "a"', "length >= 1"),
        ('[[class]]\nname = "a\\nb"\nmodel = "a"', r"class\[0\].name = 'a\\nb': must be of printable characters"),
        ('[[class]]\nname = "a"\nid = 0\nmodel = "a"', ">= 1"),
        ('[[class]]\nname = "a"\nid = 65536\nmodel = "a"', "<= 65535"),
        ('[[class]]\nname = "a"\nmodels = "a"', "unknown field `models`"),
        ('[[class]]\nname = "a"\nwhole = true\nfile = "a"', r"class\[0\] \(a\).whole needs a path, and no model"),
        ('[[class]]\nname = "a"\nwhole = true\npath = "a"\nmodel = "m"', r"class\[0\] \(a\).whole needs a path"),
        (
            '[[class]]\nname = "a"\nid = 1\nmodel = "a"\n[[class]]\nname = "a"\nid = 2\nmodel = "b"',
            r"class\[1\] \(a\).id = 2: the class has the id 1",
        ),
        (
            '[[class]]\nname = "a"\nid = 1\nmodel = "a"\n[[class]]\nname = "b"\nid = 1\nmodel = "b"',
            "two classes have the same id",
        ),
    ],
)
def test_files_that_cannot_be_used(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "classes.toml"
    path.write_text(text)
    with pytest.raises(DatasetError, match=sentence) as error:
        read_classes(path)
    assert str(error.value).startswith(f"{path}: ")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(DatasetError, match="not a regular file"):
        read_classes(tmp_path / "pipe.toml")
    with pytest.raises(DatasetError, match="No such file"):
        read_classes(tmp_path / "none.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff")
    with pytest.raises(DatasetError, match="utf-8"):
        read_classes(tmp_path / "bytes.toml")
    (tmp_path / "large.toml").write_bytes(b"#" * ((1 << 20) + 1))
    with pytest.raises(DatasetError, match="more than 1048576 bytes"):
        read_classes(tmp_path / "large.toml")


def test_patterns_take_linear_time(tmp_path: Path) -> None:
    """A pattern of many stars on a text that fits it almost; a pattern that backtracks would take years."""
    path = tmp_path / "classes.json"
    path.write_text(json.dumps({"class": [{"name": "a", "model": "a*" * 400 + "b"}]}))
    table, _ = read_classes(path)
    assert table.class_of("s", ("n",), "a" * 100_000) == 0
