"""Finds the places of a scene's objects: on surfaces without interpenetration, or at rest after a drop."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.datasets.scenario import tables
from gateway.datasets.scenario.camera_paths import uniform
from gateway.datasets.scenario.catalogue import Catalogue
from gateway.datasets.scenario.choices import ObjectChoice, SurfaceChoice
from gateway.datasets.scenario.models import LoadedModel, load_model
from gateway.datasets.scenario.physics import settle
from gateway.datasets.scenario.placement import CollisionSolid, are_apart, place_on
from gateway.datasets.scenario.surfaces import solids_of
from gateway.files.assets.scene_file import SceneFileError
from gateway.scene.tree.transforms import translation
from scenegate.datasets.manifest import pose_rows

MIN_EXTENT: Final = 1e-6
"""Minimum size of the box of an object, metres: cameras find no place around smaller ones."""
DROP_HEIGHTS: Final = 40
"""Maximum number of heights from which the drop of an object is tried."""
DROP_STEP: Final = 0.3
"""Distance of these heights, in heights of the object."""
_MAX_ROUNDS: Final = 4
"""Maximum number of drops: after objects were left out, those that they carried drop again."""


@dataclass(frozen=True, eq=False)
class SceneItem:
    """An object of a scene, before and after it has a place."""

    table: tables.Model
    choice: ObjectChoice
    """The drawn object, with its pose before it is placed."""
    solid: CollisionSolid
    """The object in its own frame, scaled."""
    X_world_object: NDArray[np.float64]
    """Pose, (4, 4). Before the object has a place: the drawn rotation, or the first pose of its track."""
    surface: int | None = None
    """Index of the surface below; None: the object does not drop."""

    @cached_property
    def in_world(self) -> CollisionSolid:
        """The object in the world."""
        return self.solid.moved(self.X_world_object)


def load_usable(catalogue: Catalogue, table: tables.Model, file: str, notes: list[str]) -> LoadedModel | None:
    """Return the model in a file; None, and a note, if it cannot be used."""
    try:
        model = load_model(catalogue, table, file)
    except (SceneFileError, OSError) as error:
        reason = str(error).removeprefix(f"{catalogue.path.parent / file}: ")
        notes.append(f"{file}: {reason}; it is left out")
        return None
    if not model.bodies({}):
        notes.append(f"{file}: it draws nothing; it is left out")
        return None
    return model


@dataclass(slots=True, eq=False)
class Arrangement:
    """Objects with places in a scene."""

    scenario: tables.Scenario
    surfaces: tuple[SurfaceChoice, ...]
    random: np.random.Generator
    notes: list[str] = field(default_factory=list)
    """Sentences about objects that are left out."""
    _placed: list[SceneItem] = field(default_factory=list)

    def add(self, item: SceneItem) -> None:
        """Find a place for an object; without one it is left out, with a note."""
        extent = float(np.ptp(item.solid.box, axis=0).max())
        if not extent >= MIN_EXTENT:
            reason = f"({item.choice.file}) has an extent of {extent:g} m, {MIN_EXTENT:g} m are the least"
            self._leave_out(item, reason)
        elif item.table.pose_track:
            self._placed.append(item)
        else:
            others = [placed.in_world for placed in self._placed if not placed.table.pose_track]
            if item.table.position is not None:
                self._add_at_position(item, item.table.position, others)
            else:
                self._add_on_surface(item, others)

    def _add_at_position(
        self, item: SceneItem, position: tuple[tables.Range[float], ...], others: list[CollisionSolid]
    ) -> None:
        """Place an object at a drawn position in the world, apart from the others."""
        is_range = any(isinstance(coordinate, tuple) for coordinate in position)
        for _ in range(self.scenario.placement.tries if is_range else 1):
            X = translation(*(uniform(self.random, coordinate) for coordinate in position)) @ item.X_world_object
            moved = replace(item, X_world_object=X)
            if all(are_apart(moved.in_world, other, self.scenario.placement.gap) for other in others):
                self._placed.append(moved)
                return
        self._leave_out(item, "has no free place at its position")

    def _add_on_surface(self, item: SceneItem, others: list[CollisionSolid]) -> None:
        """Place an object on a surface or, if objects drop, above it at the lowest of ``DROP_HEIGHTS`` that is free."""
        placement = self.scenario.placement
        allowed = [index for index, table in enumerate(self.scenario.surfaces) if item.table.on in ("", table.name)]
        surface_index = allowed[int(self.random.integers(len(allowed)))]
        surface = self.surfaces[surface_index]
        obstacles = list(others)
        for each in self.surfaces:
            top, *legs = solids_of(each)
            obstacles += legs if each is surface else (top, *legs)
        area = self.scenario.surfaces[surface_index].area or surface.size
        if placement.physics == "mujoco":
            object_height = float(np.ptp(item.in_world.box[:, 2]))
            heights = [placement.gap + level * DROP_STEP * object_height for level in range(DROP_HEIGHTS)]
            tries = max(1, placement.tries // 10)  # at each height
        else:
            heights, tries = [0.0], placement.tries
        for height in heights:
            X_world_above = translation(0.0, 0.0, height) @ np.array(surface.X_world_surface)
            X_world_object = place_on(
                item.solid, item.X_world_object, X_world_above, area, obstacles, placement.gap, tries, self.random
            )
            if X_world_object is not None:
                self._placed.append(replace(item, X_world_object=X_world_object, surface=surface_index))
                return
        x, y = area
        self._leave_out(item, f"has no free place in {x:g} x {y:g} m after {placement.tries} tries")

    def _leave_out(self, item: SceneItem, reason: str) -> None:
        self.notes.append(f"{item.choice.name} {reason}; it is left out")

    def settle(self) -> None:
        """Drop the objects, if the scenario says so. Those that fall off or do not come to rest are left out."""
        if self.scenario.placement.physics == "none":
            return
        for _ in range(_MAX_ROUNDS):
            dropping = [placed for placed in self._placed if placed.surface is not None]
            if not dropping:
                return
            static = [
                placed.in_world for placed in self._placed if placed.surface is None and not placed.table.pose_track
            ]
            static += [box for surface in self.surfaces for box in solids_of(surface)]
            starts = [(placed.solid, placed.X_world_object) for placed in dropping]
            poses_at_rest = iter(settle(starts, static, self.scenario.placement.seconds))
            before = self._placed
            self._placed = []
            for placed in before:
                kept = placed if placed.surface is None else self._at_rest(placed, next(poses_at_rest))
                if kept is not None:
                    self._placed.append(kept)
            if len(self._placed) == len(before):
                return
        raise tables.ScenarioError("placement.physics: objects fall off or do not come to rest, however few are left")

    def _at_rest(self, dropped: SceneItem, X_world_object: NDArray[np.float64] | None) -> SceneItem | None:
        """Return a dropped object at its pose at rest; None, with a note, if it has none or lies beside its surface."""
        if X_world_object is None:
            self._leave_out(dropped, f"is not at rest after {self.scenario.placement.seconds:g} s")
            return None
        moved = replace(dropped, X_world_object=X_world_object)
        if not self._is_on_surface(moved):
            self._leave_out(dropped, "has fallen off its surface")
            return None
        return moved

    def _is_on_surface(self, placed: SceneItem) -> bool:
        assert placed.surface is not None
        surface = self.surfaces[placed.surface]
        X_surface_object = np.linalg.inv(np.array(surface.X_world_surface)) @ placed.X_world_object
        low, high = placed.solid.moved(X_surface_object).box
        centre = 0.5 * (low + high)
        return bool((np.abs(centre[:2]) <= 0.5 * np.array(surface.size)).all() and centre[2] > 0.0)

    def objects(self) -> tuple[ObjectChoice, ...]:
        """Return all objects with their poses."""
        return tuple(
            msgspec.structs.replace(placed.choice, X_world_object=pose_rows(placed.X_world_object))
            for placed in self._placed
        )

    def focus_boxes(self) -> NDArray[np.float64]:
        """Return the boxes that cameras look at, (N, 2, 3): of the annotated objects, or else of the surfaces."""
        boxes = [placed.in_world.box for placed in self._placed if placed.choice.entry[0] == "models"]
        return np.array(boxes or [solids_of(surface)[0].box for surface in self.surfaces])
