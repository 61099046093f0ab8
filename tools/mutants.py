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
ROOMS = {
    "assets": ("tests/files/assets", "tests/adapters/treeviewer"),
    "cli": ("tests/cli", "tests/e2e"),
    "client": ("tests/client", "tests/datasets"),
    "datasets": ("tests/datasets",),
    "demo": ("tests/demo",),
    "gltf": ("tests/files/gltf", "tests/adapters/render"),
    "lcm": ("tests/runtime/lcm", "tests/adapters/treeviewer"),
    "render": ("tests/adapters/render",),
    "runtime": ("tests/runtime", "tests/runtime/http"),
    "scene": ("tests/scene", "tests/adapters/sceneapi", "tests/adapters/treeviewer"),
    "sceneapi": ("tests/adapters/sceneapi",),
    "server": ("tests/runtime/http", "tests/security"),
    "settings": ("tests/runtime/settings",),
    "state": ("tests/runtime/state",),
    "stereo": ("tests/renderers/stereo", "tests/adapters/stereo"),
    "treeviewer": ("tests/adapters/treeviewer", "tests/runtime/lcm"),
    "viewer": ("tests/adapters/viewer", "tests/adapters/sceneapi"),
    "wiring": ("tests/wiring", "tests/test_app.py", "tests/e2e"),
}
"""Rooms of ``gateway`` and the tests that mirror them, nearest first."""
KERNEL_ROOMS = {
    "compiler": ("tests/renderers/compiler", "tests/renderers"),
    "encode": ("tests/renderers",),
    "gltf": ("tests/files/gltf",),
    "raster": ("tests/renderers/raster", "tests/renderers"),
    "renderers": ("tests/renderers",),
    "scene": ("tests/scene",),
    "shading": ("tests/renderers/shading", "tests/renderers"),
    "stereo": ("tests/renderers/stereo", "tests/adapters/stereo"),
    "treeviewer": ("tests/adapters/treeviewer",),
}
"""Rooms with kernels, of ``renderers`` and of ``gateway``; "renderers" is what lies in no room."""
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
        """Name in ``ROOMS`` or ``KERNEL_ROOMS``."""
        return self.module.parts[1] if len(self.module.parts) > 2 else self.module.parts[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--kernels", action="store_true", help="faults in compiled kernels instead of the others")
    parser.add_argument("--rooms", nargs="*", metavar="ROOM", help="only these")
    parser.add_argument("--sample", type=int, default=60, help="number of faults, at most one a module")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--list", action="store_true", help="print the faults and run nothing")
    options = parser.parse_args()

    tests = KERNEL_ROOMS if options.kernels else ROOMS
    rooms = sorted(options.rooms or tests)
    if unknown := set(rooms) - set(tests):
        parser.error(f"there is no room {', '.join(sorted(unknown))}; there are {', '.join(sorted(tests))}")
    faults = draw_faults(rooms, options.sample, random.Random(options.seed), options.kernels)
    if options.list:
        for fault in faults:
            print(f"{fault.module}:{fault.line} {fault.operator}", difference(fault), sep="\n")
        return
    caught: dict[str, list[bool]] = {}
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        tree = copy_of_repository(Path(folder, "tree"))
        for room in sorted({fault.room for fault in faults}):
            if tests_fail(tree, tests[room], recompile=False):
                raise SystemExit(f"the tests of {room} fail without any fault: {' '.join(tests[room])}")
        for fault in faults:
            noticed = is_noticed(tree, fault, tests[fault.room])
            caught.setdefault(fault.room, []).append(noticed)
            print(f"{'caught ' if noticed else 'MISSED '} {fault.module}:{fault.line} {fault.operator}", flush=True)
            if not noticed:
                print(difference(fault), flush=True)
    print(f"\n{'room':<12} caught / tried")
    for room, results in sorted(caught.items()):
        print(f"{room:<12} {sum(results):>6} / {len(results)}")
    total = [result for results in caught.values() for result in results]
    print(f"{'all':<12} {sum(total):>6} / {len(total)}  {sum(total) / len(total):.0%}")


def draw_faults(rooms: list[str], count: int, chance: random.Random, kernels: bool) -> list[Fault]:
    """Draw at most one fault a module, from rooms in turn, so that small rooms are in the sample.

    Args:
        kernels: modules with kernels; else the others.
    """
    modules = {room: _modules(room, kernels) for room in rooms}
    for each in modules.values():
        chance.shuffle(each)
    faults: list[Fault] = []
    while len(faults) < count and any(modules.values()):
        for room in rooms:
            if modules[room] and len(faults) < count:
                module = modules[room].pop()
                if possible := list(_faults_of(module)):
                    operator, occurrence, line = chance.choice(possible)
                    code = mutate_code((ROOT / module).read_text("utf-8"), operator[1], occurrence)
                    assert code is not None
                    faults.append(Fault(module, line, operator[0], code))
    return faults


def _modules(room: str, kernels: bool) -> list[Path]:
    packages = ("gateway", "renderers") if kernels else ("gateway",)
    files = sorted(file for package in packages for file in (ROOT / package / room).rglob("*.py"))
    if room == "renderers":
        files = sorted((ROOT / room).glob("*.py"))
    return [file.relative_to(ROOT) for file in files if bool(KERNEL.search(file.read_text("utf-8"))) is kernels]


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


def is_noticed(tree: Path, fault: Fault, tests: tuple[str, ...]) -> bool:
    """Return True if one of the tests that mirror the fault's room fails with the fault in the copy."""
    file = tree / fault.module
    package, *folders = fault.module.parts[:-1]
    mirror = Path("tests", *(() if package == "gateway" else (package,)), *folders, f"test_{fault.module.name}")
    paths = (str(mirror),) if (tree / mirror).exists() else ()
    original = file.read_text("utf-8")
    file.write_text(fault.code, "utf-8")
    try:
        return tests_fail(tree, (*paths, *tests), recompile=bool(KERNEL.search(original)))
    finally:
        file.write_text(original, "utf-8")


def tests_fail(tree: Path, paths: tuple[str, ...], *, recompile: bool) -> bool:
    """Run the fast tests of these paths in the copy, in this order, up to the first failure.

    Args:
        recompile: the kernels that the tests use are compiled into a folder of their own.
    """
    python = os.environ.get("SCENEGATE_PYTHON", sys.executable)
    command = (python, "-m", "pytest", "-q", "-x", "-m", "not slow", "-p", "no:cacheprovider", *paths)
    with tempfile.TemporaryDirectory(prefix="mutants-kernels-") as kernels:
        environment = {**os.environ, **({"NUMBA_CACHE_DIR": kernels} if recompile else {})}
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
