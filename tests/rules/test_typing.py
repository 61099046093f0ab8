"""Parameters and results of kernels are annotated, and few files import the libraries that compile them."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
COMPILED = {"kernel", "device_function", "inlined"}
DECORATOR = re.compile("@(?:kernel|device_function|inlined)")
WANTED_SHARE = 0.98
IMPORT_LIBRARIES = {"numba_typing.py", "device_function.py", "cache_locator.py", "cache_folder.py"}
"""Files of ``renderers/compiler`` that import Numba or llvmlite; no others do."""


def compiled_functions() -> Iterator[ast.FunctionDef]:
    """Yield the compiled functions of the product."""
    for package in ("renderers", "gateway"):
        for path in (ROOT / package).rglob("*.py"):
            text = path.read_text()
            for node in ast.walk(ast.parse(text)) if DECORATOR.search(text) else ():
                if isinstance(node, ast.FunctionDef):
                    decorators = {ast.unparse(d.func if isinstance(d, ast.Call) else d) for d in node.decorator_list}
                    if decorators & COMPILED:
                        yield node


def test_parameters_and_results_of_kernels_are_annotated() -> None:
    functions = list(compiled_functions())
    assert len(functions) > 300
    parameters = [argument for function in functions for argument in function.args.args]
    assert sum(each.annotation is not None for each in parameters) >= WANTED_SHARE * len(parameters)
    assert [function.name for function in functions if function.returns is None] == []


def test_few_files_import_the_compiler_s_libraries() -> None:
    importing = re.compile(r"^\s*(?:from|import) (?:numba|llvmlite)\b", re.MULTILINE)
    paths = [path for package in ("renderers", "gateway") for path in (ROOT / package).rglob("*.py")]
    found = {path for path in paths if importing.search(path.read_text())}
    assert found == {ROOT / "renderers" / "compiler" / name for name in IMPORT_LIBRARIES}
