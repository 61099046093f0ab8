"""The ROS 2 package: its files agree with each other and with docs/ros2.md."""

import ast
import importlib
import runpy
import sys
import types
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest
import setuptools  # type: ignore[import-untyped]  # has no annotations
from ruamel.yaml import YAML

from tests.ros2 import stand_in
from tests.ros2.stand_in import PACKAGE

DOCS = Path(__file__).parents[2] / "docs" / "ros2.md"


@pytest.fixture
def parameters(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    stand_in.install(monkeypatch)
    found: dict[str, Any] = vars(importlib.import_module("scenegate_ros2.parameters").NodeParameters())
    return found


def described(tag: str) -> set[str]:
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    return {str(element.text) for element in manifest.iter(tag)}


def test_the_file_of_parameters_has_the_defaults(parameters: dict[str, Any]) -> None:
    file = YAML(typ="safe").load(PACKAGE / "config" / "scenegate.yaml")
    assert file["/**"]["ros__parameters"] == parameters


def test_the_page_names_each_topic() -> None:
    page = DOCS.read_text("utf-8")
    topics = importlib.import_module("scenegate_ros2.topics").TYPES
    for topic in topics:
        assert f"`{topic}`" in page


def test_setup_installs_the_files(monkeypatch: pytest.MonkeyPatch, parameters: dict[str, Any]) -> None:
    given: dict[str, Any] = {}
    monkeypatch.setattr(setuptools, "setup", lambda **arguments: given.update(arguments))
    runpy.run_path(str(PACKAGE / "setup.py"))
    assert {given["name"]} == described("name")
    assert {given["version"]} == described("version")
    installed = {name for _, names in given["data_files"] for name in names}
    assert all((PACKAGE / name).is_file() for name in installed)
    files = [path for folder in ("launch", "config") for path in (PACKAGE / folder).glob("*.*")]
    here = {str(path.relative_to(PACKAGE)) for path in files}
    assert here <= installed
    (script,) = given["entry_points"]["console_scripts"]
    name, _, target = script.partition(" = ")
    module, _, function = target.partition(":")
    assert name == "scenegate"
    assert callable(getattr(importlib.import_module(module), function))


def test_the_manifest_names_what_is_imported(parameters: dict[str, Any]) -> None:
    topics = importlib.import_module("scenegate_ros2.topics").TYPES
    needed = {message_type.partition("/")[0] for message_type in topics.values()}
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                needed.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Import):
                needed |= {alias.name.partition(".")[0] for alias in node.names}
    from_index = {"mcap_ros2", "rosbags", "scenegate", "zenoh_ros2_sdk"}
    others = {*from_index, "scenegate_ros2", "setuptools", *sys.stdlib_module_names}
    assert needed - others <= described("exec_depend")


class Configuration(str):
    """The value of a launch argument."""

    def perform(self, context: dict[str, str]) -> str:
        return context[self]


def test_the_launch_file_starts_the_node(monkeypatch: pytest.MonkeyPatch, parameters: dict[str, Any]) -> None:
    def recorded(kind: str) -> Any:
        return lambda *arguments, **named: types.SimpleNamespace(kind=kind, arguments=arguments, **named)

    contents = {
        "ament_index_python": {},
        "ament_index_python.packages": {"get_package_share_directory": lambda name: f"/share/{name}"},
        "launch": {"LaunchDescription": lambda entities: entities, "LaunchContext": dict},
        "launch.actions": {"DeclareLaunchArgument": recorded("argument"), "OpaqueFunction": recorded("function")},
        "launch.substitutions": {"LaunchConfiguration": Configuration},
        "launch_ros": {},
        "launch_ros.actions": {"Node": recorded("node")},
        "launch_ros.parameter_descriptions": {"ParameterValue": lambda value, value_type: (value, value_type)},
    }
    for name, values in contents.items():
        module = types.ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)
    generate = runpy.run_path(str(PACKAGE / "launch" / "scenegate.launch.py"))["generate_launch_description"]
    *arguments, function = generate()
    defaults = {each.arguments[0]: each.default_value for each in arguments}
    assert defaults.pop("params_file") == "/share/scenegate_ros2/config/scenegate.yaml"
    assert defaults == dict.fromkeys(("namespace", *parameters, "use_sim_time"), "")
    context = defaults | {"url": "https://robot", "tf_rate": "30", "use_sim_time": "true"}
    (node,) = function.function(context)
    assert (node.kind, node.package, node.executable) == ("node", "scenegate_ros2", "scenegate")
    given = {"url": ("url", str), "tf_rate": ("tf_rate", float), "use_sim_time": ("use_sim_time", bool)}
    assert (node.namespace, node.parameters) == ("namespace", ["params_file", given])
