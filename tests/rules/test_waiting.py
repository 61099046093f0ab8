"""No test waits a short or fixed time: a slow machine is no fault of what is tested.

Every limit is ``tests.support.waiting.SECONDS``, clients of HTTP and WebSockets come from ``tests.support.clients``,
pages of the browser from ``tests.support.browser`` (with a shorter limit), and a sleep is part of a ``while`` loop that
looks at a condition.
Where a short time of the product is the subject, the line says why it may be short: ``# short: …``.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

TESTS = Path(__file__).parent
HOLDERS = (TESTS / "support" / "clients.py", TESTS / "support" / "browser.py")
"""Files that pass the time limit to libraries."""
LIMITED = {"timeout": 0, "wait_for": 1, "wait": 0, "join": 0, "recv": 0, "handle_timeout": 0, "Barrier": 1}
"""Calls with a time limit, and which of their arguments it is."""
SLEEPS = {"sleep", "wait_for_timeout"}
HTTP = {"get", "post", "put", "patch", "delete", "head", "options", "request", "stream", "Client"}
IMPATIENT = {"TreeViewer", "AsyncTreeViewer"}
MEASURED_IN_BYTES = {"recv"}
"""Calls whose number is a size in bytes."""


def faults(source: str) -> Iterator[tuple[int, str]]:
    """Line and sentence of each call that could fail a test on a slow machine."""
    nodes = list(ast.walk(ast.parse(source)))
    polls = {id(each) for loop in nodes if isinstance(loop, ast.While) for each in ast.walk(loop)}
    for call in (node for node in nodes if isinstance(node, ast.Call)):
        owner, name = owner_and_name(call.func)
        limits = [keyword.value for keyword in call.keywords if keyword.arg in ("timeout", "open_timeout")]
        if name in LIMITED and len(call.args) > LIMITED[name]:
            limits.append(call.args[LIMITED[name]])
        for limit in limits:
            value = number(limit)
            if value and not (name in MEASURED_IN_BYTES and value >= 1024):
                yield call.lineno, f"{ast.unparse(call.func)} has a limit of its own, {value:g}"
        if name in IMPATIENT and not limits:
            yield call.lineno, f"{name} gives up after five seconds without timeout=SECONDS"
        if owner == "browser" and name == "new_page":
            yield call.lineno, "Playwright gives up after 30 s; tests.support.browser has the same"
        if name in SLEEPS and id(call) not in polls and (number(call.args[0]) != 0):
            yield call.lineno, "a sleep outside of a loop that looks at a condition"
        if owner == "httpx2" and name in HTTP:
            yield call.lineno, f"httpx2.{name} gives up after five seconds; tests.support.clients has the same"
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module == "websockets.sync.client":
            yield node.lineno, "websockets gives up after ten seconds; tests.support.clients has the same"


def owner_and_name(function: ast.expr) -> tuple[str, str]:
    """The simple name before the last dot of what is called, or "", and the name after it."""
    if isinstance(function, ast.Attribute):
        return (function.value.id if isinstance(function.value, ast.Name) else ""), function.attr
    return "", function.id if isinstance(function, ast.Name) else ""


def number(value: ast.expr) -> float | None:
    """The number that a literal is, products included; None for anything else."""
    if isinstance(value, ast.Constant) and isinstance(value.value, int | float) and not isinstance(value.value, bool):
        return float(value.value)
    if isinstance(value, ast.BinOp) and isinstance(value.op, ast.Mult):
        left, right = number(value.left), number(value.right)
        return left * right if left is not None and right is not None else None
    return None


def test_no_test_depends_on_the_speed_of_the_machine() -> None:
    found = []
    for path in sorted(set(TESTS.rglob("*.py")) - set(HOLDERS)):
        source = path.read_text()
        lines = source.splitlines()
        name = path.relative_to(TESTS)
        found += [f"{name}:{line}: {what}" for line, what in faults(source) if "# short:" not in lines[line - 1]]
    assert found == []


def test_faults_are_found_and_sound_code_is_not() -> None:
    for fault in (
        "httpx2.get(url)",
        "httpx2.Client(timeout=60.0)",
        "asyncio.timeout(10)",
        "asyncio.wait_for(one, 30.0)",
        "event.wait(10)",
        "process.wait(timeout=60)",
        "socket.recv(30)",
        "bus.handle_timeout(5000)",
        "time.sleep(0.1)",
        "for _ in range(5):\n    sleep(0.1)",
        "TreeViewer(url)",
        "page = browser.new_page()",
        "from websockets.sync.client import connect",
    ):
        assert list(faults(fault)), fault
    for sound in (
        "clients.get(url)",
        "asyncio.timeout(SECONDS)",
        "event.wait()",
        "sock.recv(1 << 16)",
        "asyncio.sleep(0)",
        "while not done():\n    time.sleep(0.1)",
        "httpx2.AsyncClient(transport=transport)",
        "', '.join(names)",
    ):
        assert not list(faults(sound)), sound
