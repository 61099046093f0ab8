"""Parameters of kernels are annotated; ``python -m tests.rules.test_typing`` prints their share."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
COMPILED = {"kernel", "device_function", "inlined"}
WANTED_SHARE = 0.98
IMPORT_LIBRARIES = {"numba_typing.py", "device_function.py", "cache_locator.py", "cache_folder.py"}
"""Files of ``renderers/compiler`` that import Numba or llvmlite; no others do."""


def compiled_functions() -> Iterator[ast.FunctionDef]:
    """Yield the compiled functions of the product."""
    for package in ("renderers", "gateway"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.FunctionDef):
                    decorators = {ast.unparse(d.func if isinstance(d, ast.Call) else d) for d in node.decorator_list}
                    if decorators & COMPILED:
                        yield node


def counts() -> tuple[int, int, int]:
    """Return the number of compiled functions, of their parameters, and of those with annotations."""
    functions = list(compiled_functions())
    parameters = [argument for function in functions for argument in function.args.args]
    return len(functions), len(parameters), sum(each.annotation is not None for each in parameters)


def test_parameters_of_kernels_are_annotated() -> None:
    functions, parameters, annotated = counts()
    assert functions > 300
    assert annotated >= WANTED_SHARE * parameters


def test_results_of_kernels_are_annotated() -> None:
    assert [function.name for function in compiled_functions() if function.returns is None] == []


def test_few_files_import_the_compiler_s_libraries() -> None:
    importing = re.compile(r"^\s*(?:from|import) (?:numba|llvmlite)\b", re.MULTILINE)
    paths = [path for package in ("renderers", "gateway") for path in (ROOT / package).rglob("*.py")]
    found = {path for path in paths if importing.search(path.read_text())}
    assert found == {ROOT / "renderers" / "compiler" / name for name in IMPORT_LIBRARIES}


if __name__ == "__main__":
    number, total, given = counts()
    print(f"{given} of {total} parameters of {number} compiled functions: {given / total:.1%}")
