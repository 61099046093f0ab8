"""Measure how many small faults the tests notice: ``make mutants``.

Draws one fault a module at random (a boundary, a sign, a condition, a dropped check; operators of cosmic-ray), applies
it in a copy of the repository, and runs the tests that mirror the module's room. A fault that no test notices is
printed as a diff: either a test is missing, or the fault changes nothing (an equivalent mutant), which is for a person
to judge.

Modules with compiled kernels have a sample of their own, ``--kernels``: a fault compiles the kernels that the tests of
its room use, for about a minute, into a cache of its own.
"""

from __future__ import annotations

import argparse
import difflib
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator, operator_names

ROOT = Path(__file__).parents[1]
PACKAGES = ("gateway", "renderers", "client/scenegate")
NEIGHBOURS = {
    "adapters/render": ("tests/drake",),
    "adapters/sceneapi": ("tests/e2e/test_interfaces.py",),
    "adapters/treeviewer": ("tests/runtime/lcm",),
    "adapters/viewer": ("tests/adapters/sceneapi",),
    "cli": ("tests/e2e",),
    "client": ("tests/adapters/treeviewer", "tests/runtime/lcm", "tests/datasets", "tests/cli"),
    "files/assets": ("tests/adapters/treeviewer",),
    "files/gltf": ("tests/adapters/render", "tests/datasets/scenario"),
    "files/parsers": ("tests/files/assets",),
    "replay": ("tests/e2e/test_view.py",),
    "runtime/http": ("tests/security",),
    "runtime/lcm": ("tests/adapters/treeviewer",),
    "runtime/logs": ("tests/wiring",),
    "scene/draw": ("tests/adapters/sceneapi", "tests/adapters/treeviewer"),
    "scene/tree": ("tests/adapters/sceneapi", "tests/adapters/treeviewer"),
    "renderers": ("tests/runtime/workers",),
    "stereo": ("tests/adapters/stereo",),
    "stereo/device": ("tests/adapters/stereo",),
    "stereo/imaging": ("tests/adapters/stereo",),
    "stereo/routes": ("tests/adapters/stereo",),
    "stereo/stream": ("tests/adapters/stereo",),
    "wiring": ("tests/test_app.py", "tests/e2e"),
}
"""Further tests of rooms, by the end of the room's name: they run after those in the folder that mirrors it."""
EQUIVALENT = ("_Eq_Is", "_NotEq_IsNot", "_Is_Eq", "_IsNot_NotEq")
"""Endings of operators that swap equality and identity: the same for None, booleans, enums and interned strings."""
OPERATORS = (
    "core/AddNot",
    "core/NumberReplacer",
    "core/ReplaceAndWithOr",
    "core/ReplaceOrWithAnd",
    "core/ReplaceTrueWithFalse",
    "core/ReplaceFalseWithTrue",
    "core/ReplaceUnaryOperator_Delete_USub",
    "core/ReplaceUnaryOperator_Delete_Not",
    "core/ReplaceBinaryOperator_Add_Sub",
    "core/ReplaceBinaryOperator_Sub_Add",
    "core/ReplaceBinaryOperator_Mul_Div",
    "core/ReplaceBinaryOperator_Div_Mul",
    "core/ReplaceBinaryOperator_FloorDiv_Mul",
    "core/ReplaceBinaryOperator_Mod_Mul",
    *sorted(
        name
        for name in operator_names()
        if name.startswith("core/ReplaceComparisonOperator") and not name.endswith(EQUIVALENT)
    ),
)
KERNEL = re.compile(r"^\s*@(kernel|device_function|inlined|cached_njit|njit|intrinsic)\b", re.MULTILINE)
"""Decorators of what is compiled."""
PYTHON = os.environ.get("MUTANTS_PYTHON", sys.executable)
TEST_SECONDS = 900
"""Longest run of a room's tests; a fault that makes them longer counts as noticed."""


@dataclass(frozen=True)
class Fault:
    """One changed place of one module."""

    module: Path
    line: int
    operator: str
    code: str
    """The whole module with the fault."""

    @property
    def room(self) -> str:
        """The folder below tests/ that mirrors the module's."""
        return room_of(self.module)


def room_of(module: Path) -> str:
    """Return the folder below tests/ that mirrors a module's, or the nearest one above that does."""
    package, *folders = module.parent.parts
    if package == "client":
        return "client"
    room = Path(*folders) if package == "gateway" else Path(package, *folders)
    while not (ROOT / "tests" / room / "__init__.py").exists():
        room = room.parent
    return "" if room == Path() else room.as_posix()


def tests_of(room: str) -> tuple[str, ...]:
    """Return the paths of a room's tests, nearest first."""
    further = [paths for end, paths in NEIGHBOURS.items() if room.split("/")[-1] == end or room.endswith(end)]
    return (f"tests/{room}" if room else "tests/test_app.py", *(path for paths in further for path in paths))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--kernels", action="store_true", help="faults in compiled kernels instead of the others")
    parser.add_argument("--rooms", nargs="*", metavar="ROOM", help="only these")
    parser.add_argument("--sample", type=int, default=60, help="number of faults, at most one a module")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--list", action="store_true", help="print the faults and run nothing")
    options = parser.parse_args()

    modules = modules_of_rooms(options.kernels)
    rooms = sorted(options.rooms or modules)
    if unknown := set(rooms) - set(modules):
        parser.error(f"there is no room {', '.join(sorted(unknown))}; there are {', '.join(sorted(modules))}")
    faults = draw_faults({room: modules[room] for room in rooms}, options.sample, random.Random(options.seed))
    if options.list:
        for fault in faults:
            print(f"{fault.module}:{fault.line} {fault.operator}", difference(fault), sep="\n")
        return
    caught: dict[str, list[bool]] = {}
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        tree = copy_of_repository(Path(folder, "tree"))
        subprocess.run((PYTHON, "-m", "scenegate", "warmup"), cwd=tree, check=True)  # tests wait for nothing then
        for room in sorted({fault.room for fault in faults}):
            if tests_fail(tree, tests_of(room), recompile=False):
                raise SystemExit(f"the tests of {room} fail without any fault: {' '.join(tests_of(room))}")
        for fault in faults:
            noticed = is_noticed(tree, fault)
            caught.setdefault(fault.room, []).append(noticed)
            print(f"{'caught ' if noticed else 'MISSED '} {fault.module}:{fault.line} {fault.operator}", flush=True)
            if not noticed:
                print(difference(fault), flush=True)
    print(f"\n{'room':<12} caught / tried")
    for room, results in sorted(caught.items()):
        print(f"{room:<12} {sum(results):>6} / {len(results)}")
    total = [result for results in caught.values() for result in results]
    print(f"{'all':<12} {sum(total):>6} / {len(total)}  {sum(total) / len(total):.0%}")


def modules_of_rooms(kernels: bool) -> dict[str, list[Path]]:
    """Return the modules of each room.

    Args:
        kernels: modules with kernels; else the others.
    """
    rooms: dict[str, list[Path]] = {}
    for file in sorted(file for package in PACKAGES for file in (ROOT / package).rglob("*.py")):
        if bool(KERNEL.search(file.read_text("utf-8"))) is kernels and not file.name.endswith("_pb2.py"):
            module = file.relative_to(ROOT)
            rooms.setdefault(room_of(module), []).append(module)
    return rooms


def draw_faults(modules: dict[str, list[Path]], count: int, chance: random.Random) -> list[Fault]:
    """Draw at most one fault a module, from rooms in turn, so that small rooms are in the sample."""
    for each in modules.values():
        chance.shuffle(each)
    faults: list[Fault] = []
    while len(faults) < count and any(modules.values()):
        for left in modules.values():
            if left and len(faults) < count:
                module = left.pop()
                if possible := list(_faults_of(module)):
                    operator, occurrence, line = chance.choice(possible)
                    code = mutate_code((ROOT / module).read_text("utf-8"), operator[1], occurrence)
                    assert code is not None
                    faults.append(Fault(module, line, operator[0], code))
    return faults


def _faults_of(module: Path) -> Iterator[tuple[tuple[str, Operator], int, int]]:
    """Yield operator, occurrence and line of each possible fault inside functions."""
    tree = get_ast((ROOT / module).read_text("utf-8"))
    bodies = [(node.start_pos[0], node.end_pos[0]) for node in ast_nodes(tree) if node.type == "funcdef"]
    for name in OPERATORS:
        operator = get_operator(name)()
        positions = [place for node in ast_nodes(tree) for place in operator.mutation_positions(node)]
        for occurrence, ((line, _), _end) in enumerate(positions):
            if any(first < line <= last for first, last in bodies):
                yield (name, operator), occurrence, line


def copy_of_repository(folder: Path) -> Path:
    """Copy the files that git knows, as they are in the working tree."""
    names = subprocess.run(
        ("git", "ls-files", "-z"), cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split("\0")
    for name in filter(None, names):
        if (ROOT / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    return folder


def is_noticed(tree: Path, fault: Fault) -> bool:
    """Return True if one of the tests of the fault's room fails with the fault in the copy."""
    file = tree / fault.module
    mirror = Path("tests", fault.room, f"test_{fault.module.name}")
    paths = (str(mirror),) if (tree / mirror).exists() else ()
    original = file.read_text("utf-8")
    file.write_text(fault.code, "utf-8")
    try:
        return tests_fail(tree, (*paths, *tests_of(fault.room)), recompile=bool(KERNEL.search(original)))
    finally:
        file.write_text(original, "utf-8")


def tests_fail(tree: Path, paths: tuple[str, ...], *, recompile: bool) -> bool:
    """Run the fast tests of these paths in the copy, in this order, up to the first failure.

    Args:
        recompile: the kernels that the tests use are compiled into a folder of their own.
    """
    command = (PYTHON, "-m", "pytest", "-q", "-x", "-m", "not slow", "-p", "no:cacheprovider", *paths)
    with tempfile.TemporaryDirectory(prefix="mutants-kernels-") as kernels:
        # Before the installed packages, also in programs that the tests start in other folders.
        environment = {**os.environ, "PYTHONPATH": f"{tree}{os.pathsep}{tree / 'client'}"}
        if recompile:
            environment["NUMBA_CACHE_DIR"] = kernels
        try:
            ended = subprocess.run(
                command, cwd=tree, env=environment, capture_output=True, timeout=TEST_SECONDS, check=False
            )
        except subprocess.TimeoutExpired:
            return True
    return ended.returncode != 0


def difference(fault: Fault) -> str:
    """Return the fault as a unified diff."""
    before = (ROOT / fault.module).read_text("utf-8").splitlines()
    return "\n".join(list(difflib.unified_diff(before, fault.code.splitlines(), lineterm="", n=1))[2:])


if __name__ == "__main__":
    main()
