"""Reading scenario files: errors, and the schema for editors."""

import json
import tomllib
from pathlib import Path

import pytest

from gateway.datasets.scenario import catalogue
from gateway.datasets.scenario.catalogue import read_catalogue
from gateway.datasets.scenario.file import read_scenario, schema_text
from gateway.datasets.scenario.tables import ScenarioError
from tests.datasets.scenario.conftest import TABLE, Write

ROOT = Path(__file__).parents[3]
EXAMPLES = sorted((ROOT / "examples" / "scenario").glob("*.toml"))
MODEL = "[[models]]\npath = 'models/can.urdf'\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MODEL + "colour = 1", "models[0]: object contains unknown field `colour`"),
        (MODEL + "scale = -2", "models[0].scale: expected `float` > 0.0, not -2"),
        (MODEL + "scale = [1, 0]", "models[0].scale[1]: expected `float` > 0.0, not 0"),
        (MODEL + "scale = [1, 2, 3]", "models[0].scale: expected `array` of length <= 2, not [1, 2, 3]"),
        (MODEL + "scale = nan", "models[0].scale: expected `float` > 0.0, not nan"),
        (MODEL + "count = [1, 2000]", "models[0].count[1]: expected `int` <= 1000, not 2000"),
        (MODEL + "count = 600\n[[distractors]]\npath = 'a'\ncount = [1, 500]", "count is up to 1100 together, 1000 ar"),
        (MODEL + "joints = {elbow = 'x'}", "models[0].joints[...]: expected `float | array`, not {'elbow': 'x'}"),
        (MODEL + "joints = {elbow = ['a', 1]}", "models[0].joints[...][0]: expected `float`, not {'elbow': ['a', 1]}"),
        (MODEL + "joints = {elbow = [nan, 0]}", "models[0].joints[...][0]: expected `float`"),
        (MODEL + "joints = {elbow = [1e308, 0]}", "models[0].joints[...][0]: expected `float` <= 1000000.0"),
        (MODEL + "joints = {elbow = [[], 1]}", "models[0].joints[...][0]: expected `float`"),
        (MODEL + "up = 'x'", "models[0].up: invalid enum value 'x': must be 'auto' or 'y' or 'z'"),
        (MODEL + "on = 'desk'", "models[0].on: no surface has the name 'desk'"),
        (MODEL + "pose_track = 'a.csv'", "models[0]: it moves, so [frames] must have the count of frames"),
        (MODEL + "animation = 0", "models[0]: it moves, so [frames] must have the count of frames"),
        ("seed = 'x'", "seed: expected `int`, not 'x'"),
        ("scenes = 0", "scenes: expected `int` >= 1, not 0"),
        ("[[models]]\npath = []", "models[0].path: "),
        ("[[models]]\nscale = 1", "models[0]: object missing required field `path`"),
        ("[[cameras]]\nkind = 'orbit'", "cameras[0].kind: invalid value 'orbit': must be 'fixed' or 'handheld' or 's"),
        ("[[cameras]]\nkind = 'handheld'", "cameras[0]: a handheld camera moves, so [frames] must have the count"),
        ("cameras = []", "cameras: 0 views of a scene; there must be 1 to 100000"),
        ("[[cameras]]\nkind = 'shell'\ncount = 200\n[frames]\ncount = 1000", "cameras: 200000 views of a scene"),
        ("[[cameras]]\nkind = 'fixed'\neye = [1, 1, 1]\ntarget = [1, 1, 1]", "cameras[0]: camera eye and target coin"),
        ("surfaces = []", "surfaces: there must be one"),
        ("[sensor]\ngain = 90", "sensor.gain: expected `float` <= 40.0, not 90"),
        ("[placement]\nphysics = 'bullet'", "placement.physics: invalid enum value 'bullet': must be 'mujoco' or 'n"),
        ("seed = [", "Invalid value (at end of document)"),
    ],
)
def test_errors_name_file_key_value_and_limit(write: Write, text: str, message: str) -> None:
    path = write(text)
    with pytest.raises(ScenarioError) as raised:
        read_scenario(path)
    assert str(raised.value).startswith(f"{path}: ")
    assert message in str(raised.value)


def test_a_missing_file_and_a_folder_without_models(write: Write, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="No such file"):
        read_catalogue(tmp_path / "none.toml")
    empty = read_catalogue(write("[[models]]\npath = 'nothing/*.obj'"))
    with pytest.raises(ScenarioError, match=r"models\[0\].path: 'nothing/\*.obj'"):
        _ = empty.models


def test_a_path_may_be_a_list(write: Write) -> None:
    path = write("[[models]]\npath = ['m/*.obj', 'm/a.obj', 'one.stl']")
    (path.parent / "m").mkdir()
    for name in ("m/b.obj", "m/a.obj", "one.stl"):
        (path.parent / name).write_text("")
    assert read_catalogue(path).models == {("models", 0): ("m/a.obj", "m/b.obj", "one.stl")}
    missing = read_catalogue(write("[[models]]\npath = ['m/*.obj', 'none.obj']"))
    with pytest.raises(ScenarioError, match=r"models\[0\].path: 'none.obj'"):
        _ = missing.models


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_schema_accepts_examples(path: Path) -> None:
    read_scenario(path)
    jsonschema = pytest.importorskip("jsonschema")  # a part of check-jsonschema
    schema = json.loads(schema_text())
    jsonschema.validate(tomllib.loads(path.read_text()), schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"models": [{"path": "a", "scale": -1}]}, schema)


def test_the_published_schema_is_that_of_the_code() -> None:
    assert (ROOT / "docs" / "scenario.schema.json").read_text() == schema_text()


def test_the_schema_describes_fields() -> None:
    """Also those that a table has from another one."""
    definitions = json.loads(schema_text())["$defs"]
    assert definitions["Handheld"]["properties"]["shake"]["description"].startswith("Amplitude of the hand's shaking")
    assert definitions["Handheld"]["properties"]["azimuth"]["description"] == "Degrees counter-clockwise from +x."
    assert definitions["Placement"]["properties"]["physics"]["description"].startswith("`mujoco`: objects drop")


def test_names_of_models_are_the_shortest_that_differ(write: Write) -> None:
    path = write("[[models]]\npath = '.'")
    folder = path.parent
    for name in ("a/box.urdf", "b/box.urdf", "b/can.obj"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("x")
    (folder / "models" / "can.urdf").rename(folder / "tin.urdf")
    names = read_catalogue(path).model_names
    assert {names["a/box.urdf"], names["b/box.urdf"], names["b/can.obj"]} == {"a/box", "b/box", "can"}
    assert names["models/ball.urdf"] == "ball"


def test_names_of_files_that_differ_in_their_suffixes(write: Write, tmp_path: Path) -> None:
    folder = write().parent
    for name in ("m/bread.obj", "m/bread.stl", "n/bread.stl", "m/tin.obj", "../outside/tin.stl"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("x")
    path = write(f"models = [{{path = 'm'}}, {{path = '{folder}/n'}}, {{path = '{tmp_path}/outside'}}]")
    assert read_catalogue(path).model_names == {
        "m/bread.obj": "bread.obj",
        "m/bread.stl": "bread.stl",
        f"{folder}/n/bread.stl": "bread",
        "m/tin.obj": "m/tin",
        f"{tmp_path}/outside/tin.stl": "outside/tin",
    }


@pytest.mark.parametrize("pattern", ["m", "m/**/*.obj", "**/m/**/*.obj"])
def test_links_to_folders_are_not_followed(write: Write, pattern: str) -> None:
    path = write(f"models = [{{path = '{pattern}'}}]")
    folder = path.parent / "m" / "deep"
    folder.mkdir(parents=True)
    (folder / "a.obj").write_text("x")
    (folder / ".hidden").mkdir()
    (folder / ".hidden" / "b.obj").write_text("x")
    for k in range(30):  # 2 ** 30 paths if they were followed
        (folder / f"up{k}").symlink_to(folder.parent)
    assert read_catalogue(path).models == {("models", 0): ("m/deep/a.obj",)}


def test_the_number_of_entries_is_limited(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "MAX_ENTRIES", 5)
    for pattern in (".", "**/*.stl"):
        with pytest.raises(ScenarioError, match=r"models\[0\].path: .* 5 files"):
            _ = read_catalogue(write(f"models = [{{path = '{pattern}'}}]", f"n{len(pattern)}")).models


def test_the_digest_depends_on_values_and_files_but_not_on_the_number_of_scenes(write: Write) -> None:
    def digest(text: str, name: str) -> str:
        return read_catalogue(write(text, name)).digest

    before = digest(TABLE, "a")
    assert digest(TABLE.replace("scenes = 9", "scenes = 20"), "b") == before
    assert digest(TABLE + "# a comment", "c") == before
    assert digest(TABLE.replace("seed = 5", "seed = 6"), "d") != before
    path = write(TABLE, "e")
    (path.parent / "models" / "tin.urdf").write_bytes((path.parent / "models" / "can.urdf").read_bytes())
    assert read_catalogue(path).digest != before
