"""Draws the choices of a scene from the seed of its scenario and its number, and nothing else."""

from collections.abc import Sequence
from typing import Any, Final, TypeVar

import numpy as np

from gateway.datasets.scenario import tables
from gateway.datasets.scenario.arrangement import Arrangement, SceneItem, load_usable
from gateway.datasets.scenario.camera_paths import draw_cameras, uniform
from gateway.datasets.scenario.catalogue import Catalogue
from gateway.datasets.scenario.choices import (
    BackgroundChoice,
    Choice,
    LampChoice,
    LightChoice,
    MaterialChoice,
    ObjectChoice,
    SceneChoices,
    SensorChoice,
    SurfaceChoice,
)
from gateway.datasets.scenario.models import LoadedModel
from gateway.datasets.scenario.placement import CollisionSolid, rotation_of
from gateway.datasets.scenario.scenery import lamp_direction
from gateway.datasets.scenario.tracks import read_track
from gateway.scene.tree.transforms import translation
from scenegate.datasets.manifest import Vector3, pose_rows
from scenegate.regular_files import errors_as
from scenegate.robots.robot_errors import RobotFileError

ChoiceType = TypeVar("ChoiceType", bound=Choice)
_STREAMS: Final = ("surfaces", "models", "distractors", "places", "cameras", "lights", "background", "sensor")
"""Sources of random numbers, each with a sequence of its own: more lights do not move the cameras."""


def draw_choices(catalogue: Catalogue, number: int) -> SceneChoices:
    """Return the choices of a scene, equal for the same scenario, files and number. Raises ScenarioError."""
    return _Drawing(catalogue, number).choices()


def _drawn(random: np.random.Generator, kind: type[ChoiceType], table: tables.Table, **given: Any) -> ChoiceType:
    """Return a choice. Fields that are not given are drawn from the table's fields of that name, in their order."""
    values = dict(given)
    for name in kind.__struct_fields__:
        if name not in given:
            value = getattr(table, name)
            if isinstance(value, tuple):
                is_color = isinstance(value[0], tuple)
                value = _color(random, value) if is_color else uniform(random, value)
            values[name] = value
    return kind(**values)


def _color(random: np.random.Generator, colors: Sequence[Vector3]) -> Vector3:
    """Return a colour between the first and the last one."""
    red, green, blue = (uniform(random, channel) for channel in zip(colors[0], colors[-1], strict=True))
    return red, green, blue


def _count(random: np.random.Generator, count: tables.Range[int]) -> int:
    return count if isinstance(count, int) else int(random.integers(min(count), max(count) + 1))


class _Drawing:
    def __init__(self, catalogue: Catalogue, number: int) -> None:
        self._catalogue = catalogue
        self._scenario = catalogue.scenario
        self._number = number

    def _random(self, stream: str, index: int = 0) -> np.random.Generator:
        """Return the source of random numbers of a table."""
        key = (self._number, _STREAMS.index(stream), index)
        return np.random.Generator(np.random.Philox(np.random.SeedSequence(self._scenario.seed, spawn_key=key)))

    def choices(self) -> SceneChoices:
        """Return all choices of the scene."""
        scenario = self._scenario
        surfaces = tuple(self._surface(index, table) for index, table in enumerate(scenario.surfaces))
        arrangement = Arrangement(scenario, surfaces, self._random("places"))
        items = [
            item
            for kind, models in (("models", scenario.models), ("distractors", scenario.distractors))
            for index, table in enumerate(models)
            for item in self._objects(kind, index, table, arrangement.notes)
        ]
        for item in sorted(items, key=lambda each: each.table.position is None):  # those with a position first
            arrangement.add(item)
        arrangement.settle()
        boxes = arrangement.focus_boxes()
        cameras = [
            choice
            for index, camera in enumerate(scenario.cameras)
            for choice in draw_cameras(camera, boxes, scenario.frames, self._random("cameras", index))
        ]
        return SceneChoices(
            seed=scenario.seed,
            number=self._number,
            surfaces=surfaces,
            objects=arrangement.objects(),
            cameras=tuple(cameras),
            light=self._light(scenario.lights),
            background=self._background(scenario.backgrounds),
            sensor=_drawn(self._random("sensor"), SensorChoice, scenario.sensor) if scenario.sensor else None,
            notes=tuple(arrangement.notes),
        )

    def _file(self, random: np.random.Generator, key: str) -> str:
        """Return a drawn file of those that a key names; empty if it names none."""
        files = self._catalogue.other_files.get(key)
        return files[int(random.integers(len(files)))] if files else ""

    def _material(self, random: np.random.Generator, table: tables.Materials, key: str) -> MaterialChoice:
        return _drawn(random, MaterialChoice, table, texture=self._file(random, f"{key}.textures"))

    def _surface(self, index: int, table: tables.Surface) -> SurfaceChoice:
        random = self._random("surfaces", index)
        x, y = (uniform(random, each) for each in table.position)
        X = translation(x, y, uniform(random, table.height)) @ rotation_of(0.0, 0.0, uniform(random, table.turn))
        material = self._material(random, table.material, f"surfaces[{index}].material")
        return SurfaceChoice(kind=table.kind, size=table.size, X_world_surface=pose_rows(X), material=material)

    def _objects(self, kind: str, index: int, table: tables.Model, notes: list[str]) -> list[SceneItem]:
        """Return the objects of a table of models, without their places."""
        random = self._random(kind, index)
        files, materials = self._catalogue.models[kind, index], self._scenario.materials
        items = []
        for number in range(_count(random, table.count)):
            file = files[int(random.integers(len(files)))]
            model = load_usable(self._catalogue, table, file, notes)
            scale = uniform(random, table.scale)
            roll, pitch, yaw = (uniform(random, each) for each in table.rotation)
            material = None
            if materials is not None and random.random() < materials.share:
                material = self._material(random, materials, "materials")
            if model is None:  # after the draws that need no model: they are the same for the next object
                continue
            model_name = self._catalogue.model_names[file]
            X_world_object = rotation_of(roll, pitch, yaw)
            if table.pose_track:
                start = 0.0 if self._scenario.frames is None else self._scenario.frames.start
                track = read_track(self._catalogue.path.parent / table.pose_track, poses=True)
                X_world_object = track.pose_at(start)
            choice = ObjectChoice(
                entry=(kind, index),
                file=file,
                model=model_name,
                name=f"{model_name} {kind[0]}{index}.{number}",
                X_world_object=pose_rows(X_world_object),
                scale=scale,
                joints=_joints(random, table, model),
                material=material,
            )
            with errors_as(tables.ScenarioError, file, RobotFileError):  # joint values that the model cannot have
                bodies = model.bodies(choice.joints)
            solid = CollisionSolid(tuple(body * scale for body in bodies))
            items.append(SceneItem(table, choice, solid, X_world_object))
        return items

    def _light(self, table: tables.Lights) -> LightChoice:
        random = self._random("lights")
        lamps = []
        for lamp in table.lamps:
            direction = lamp_direction(uniform(random, lamp.azimuth), uniform(random, lamp.elevation))
            lamps.append(_drawn(random, LampChoice, lamp, direction=direction))
        rig, environment = (self._file(random, key) for key in ("lights.rigs", "lights.environments"))
        turn = float(np.radians(uniform(random, table.turn)))
        return _drawn(random, LightChoice, table, rig=rig, environment=environment, turn=turn, lamps=tuple(lamps))

    def _background(self, table: tables.Backgrounds) -> BackgroundChoice:
        random = self._random("background")
        color = None
        if table.color is not None:
            red, green, blue = (round(255.0 * channel) for channel in _color(random, table.color))
            color = red, green, blue
        return BackgroundChoice(image=self._file(random, "backgrounds.images"), color=color)


def _joints(random: np.random.Generator, table: tables.Model, model: LoadedModel) -> dict[str, tuple[float, ...]]:
    """Return drawn joint values: of the table's ranges, or between the limits of the robot's file."""
    if isinstance(table.joints, dict):
        return {name: (uniform(random, values),) for name, values in table.joints.items()}
    ranges: dict[str, tables.Range[float]] = {}
    for name, joint in ({} if model.robot is None else model.robot.joints).items():
        if joint.mimic is None and joint.kind in ("revolute", "prismatic"):
            without_limits = (-np.pi, np.pi) if joint.kind == "revolute" else joint.default[0]
            ranges[name] = joint.limits or without_limits
    return {name: (uniform(random, values),) for name, values in ranges.items()}
