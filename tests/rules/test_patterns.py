"""Regular expressions take linear time: nobody can freeze a process by text that backtracks.

Each compiled pattern of a module is used on megabytes of text that fits it almost. A pattern that is quadratic would
take hours for them: a child process with a limit on its time uses the patterns.
"""

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from gateway.runtime.workers.limited_process import ProcessFailed, ProcessLimits, call_limited

ROOT = Path(__file__).parents[2]
SIZE = 1 << 16
"""Characters of each text. A quadratic pattern takes 4 * 10^9 steps, more than 20 s."""
LIMITS = ProcessLimits(1 << 31, 10)
"""For one pattern, which takes less than 0.2 s of CPU time."""
FILLERS = (
    " ",
    "a",
    "A",
    "0",
    "_",
    "=",
    "-",
    ".",
    "+",
    "<",
    "[",
    '"',
    ";",
    "\xff",
    "\xff\0",
    "0.",
    "1e",
    "a=",
    "<a ",
    "a:",
)
"""Texts to repeat, besides the literal parts of a pattern."""
Pattern = tuple[Path, str | bytes, int, bool]
"""File, pattern, flags, and True if the module searches for it; else it is matched at a position."""
SEARCHES = ("search", "sub", "split", "finditer", "findall")


def module_patterns() -> Iterator[Pattern]:
    """Yield the module-level patterns, and how their modules use them."""
    for folder in ("gateway", "renderers"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            text = path.read_text()
            if "re.compile(" not in text or "reference" in path.parts:
                continue
            for statement in ast.parse(text).body:
                if not isinstance(statement, (ast.Assign, ast.AnnAssign)) or not isinstance(statement.value, ast.Call):
                    continue
                if ast.unparse(statement.value.func) != "re.compile":
                    continue
                pattern, *flags = statement.value.args
                target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
                is_searched = any(f"{ast.unparse(target)}.{method}(" in text for method in SEARCHES)
                value = sum(getattr(re, ast.unparse(flag).removeprefix("re.")) for flag in flags)
                yield path, ast.literal_eval(pattern), value, is_searched


PATTERNS = list(module_patterns())


def texts(pattern: str | bytes) -> Iterator[str]:
    """Yield long texts: each literal part and filler repeated, and each literal part before a repeated filler."""
    source = pattern if isinstance(pattern, str) else pattern.decode("latin-1")
    words = re.findall(r"[A-Za-z0-9<>/\"'=:_ -]+", re.sub(r"\\.|\{.*?\}", "|", source))
    for filler in dict.fromkeys((*words, *FILLERS)):
        run = filler * (SIZE // len(filler))
        yield run + "\0"
        for word in words[:8]:
            yield word + run + "\0"
            yield (word + filler) * (SIZE // len(word + filler)) + "\0"


def use_pattern(read_file: Callable[[str], bytes], data: bytes, is_text: bool, flags: int, is_searched: bool) -> int:
    """Use a pattern on all texts; called in the child process. Return the number of texts."""
    pattern = data.decode("utf-8", "surrogatepass") if is_text else data
    compiled: Any = re.compile(pattern, flags)
    count = 0
    for text in texts(pattern):
        read_file(repr(text[:40]))
        used = text if is_text else text.encode("latin-1")
        if is_searched:
            for _ in compiled.finditer(used):
                pass
        compiled.match(used)
        compiled.fullmatch(used)
        count += 1
    return count


def try_pattern(pattern: str | bytes, flags: int, is_searched: bool, limits: ProcessLimits = LIMITS) -> int:
    """Use a pattern in a child process. Fail with the text that takes too long."""
    last = ""

    def note(name: str) -> bytes:
        nonlocal last
        last = name
        return b""

    is_text = isinstance(pattern, str)
    data = pattern.encode("utf-8", "surrogatepass") if isinstance(pattern, str) else pattern
    arguments = (data, is_text, flags, is_searched)
    try:
        result: int = msgspec.msgpack.decode(
            call_limited("tests.rules.test_patterns:use_pattern", arguments, limits, note)
        )
    except ProcessFailed as error:
        pytest.fail(f"{pattern!r} on {last}: {error}")
    return result


@pytest.mark.slow
def test_patterns_take_linear_time() -> None:
    assert len(PATTERNS) > 10
    for _, pattern, flags, is_searched in PATTERNS:
        assert try_pattern(pattern, flags, is_searched) >= len(FILLERS)


def test_patterns_are_compiled_at_the_top_of_modules() -> None:
    """The test above finds no others."""
    allowed = {"adapters/stereo/imaging/recorded_pairs.py"}
    known = {path for path, *_ in PATTERNS}
    users = {
        path for path in (ROOT / "gateway").rglob("*.py") if re.search(r"(?<![.\w])re\.[a-z]+\(", path.read_text())
    }
    others = {path.relative_to(ROOT / "gateway").as_posix() for path in users - known if "reference" not in path.parts}
    assert others <= allowed


@pytest.mark.parametrize("pattern", [r"\s+$", r"<unit\b[^>]*\bmeter\s*="])
def test_a_quadratic_pattern_is_found(pattern: str) -> None:
    with pytest.raises(pytest.fail.Exception, match="it took longer than 1 s"):
        try_pattern(pattern, 0, is_searched=True, limits=ProcessLimits(1 << 31, 1))
