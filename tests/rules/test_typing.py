"""Modules exempt from type checking are those with kernels, and no others."""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
COMPILED = {
    "kernel",
    "device_function",
    "inlined",
    "njit",
    "cached_njit",
    "intrinsic",
    "overload",
    "overload_method",
    "overload_attribute",
    "lower_builtin",
}
"""Numba's decorators: it finds the types itself."""


def modules() -> list[Path]:
    """Files in which functions may be without annotations."""
    overrides = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]["overrides"]
    names = [name for entry in overrides if entry.get("disallow_untyped_defs") is False for name in entry["module"]]
    globs = [
        f"{name.removesuffix('.*').replace('.', '/')}{'/**/*.py' if name.endswith('.*') else '.py'}" for name in names
    ]
    found = [list(ROOT.glob(glob)) for glob in globs]
    assert all(found), "an override is of nothing"
    return [path for paths in found for path in paths]


def annotated(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    given = function.args
    arguments = [*given.posonlyargs, *given.args, *given.kwonlyargs]
    return function.returns is not None and all(a.annotation or a.arg in ("self", "cls") for a in arguments)


def compiled(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    names = {ast.unparse(d.func if isinstance(d, ast.Call) else d) for d in function.decorator_list}
    return bool(names & COMPILED)


def test_only_kernels_are_without_annotations() -> None:
    bare = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.name}"
        for path in modules()
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not annotated(node) and not compiled(node)
    ]
    assert bare == []
