"""Classes of objects."""

import json
import os
import tomllib
from pathlib import Path

import pytest

from gateway.datasets import classes
from gateway.datasets.classes import ClassTable, classes_of_models, read_classes
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
TWO = '[[class]]\nname = "a"\nid = 1\nmodel = "a"\n[[class]]\nname = "{}"\nid = {}\nmodel = "b"'


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


def table_of(folder: Path, text: str) -> ClassTable:
    path = folder / "classes.toml"
    path.write_text(text)
    return read_classes(path)[0]


def test_objects_without_a_class(tmp_path: Path) -> None:
    table = table_of(tmp_path, '[[class]]\nname = "a"\nmodel = "[ab]*"')
    assert [table.class_of("s", ("n",), model) for model in ("a", "b1", "c", "A")] == [1, 1, 0, 0]


def test_whole_nodes(tmp_path: Path) -> None:
    whole = '[[class]]\nname = "a"\nfile = "*.glb"\npath = "x/*"\nwhole = true\n'
    table = table_of(tmp_path, f'{whole}[[class]]\nname = "b"\npath = "*"')
    nodes = ("x",), ("x", "y"), ("x", "y", 3), ("y",)
    assert [table.is_whole("s.glb", node) for node in nodes] == [False, True, True, False]
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
        (TWO.format("a", 2), r"class\[1\] \(a\).id = 2: the class has the id 1"),
        (TWO.format("b", 1), "two classes have the same id"),
    ],
)
def test_files_that_cannot_be_used(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(DatasetError, match=sentence) as error:
        table_of(tmp_path, text)
    assert str(error.value).startswith(f"{tmp_path}/classes.toml: ")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff")
    (tmp_path / "large.toml").write_bytes(b"#" * ((1 << 20) + 1))
    for name, sentence in (
        ("pipe", "not a regular file"),
        ("none", "No such file"),
        ("bytes", "utf-8"),
        ("large", "more than 1048576 bytes"),
    ):
        with pytest.raises(DatasetError, match=sentence):
            read_classes(tmp_path / f"{name}.toml")


def test_patterns_take_linear_time(tmp_path: Path) -> None:
    """A pattern of many stars on a text that fits it almost; a pattern that backtracks would take years."""
    table = table_of(tmp_path, f'[[class]]\nname = "a"\nmodel = "{"a*" * 400}b"')
    assert table.class_of("s", ("n",), "a" * 100_000) == 0
