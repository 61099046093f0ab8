"""Run Director's own client and its three tests of the tree viewer, unmodified, against a running viewer.

    python -m tests.adapters.treeviewer.director_checkout CHECKOUT [--url LCM_URL]

CHECKOUT is a clone of github.com/RobotLocomotion/director; nothing of it is part of this project. Its files need two
things that today's Python lacks: ``collections.Iterable``, and ``sys`` in tests that forget to import it (Director runs
them in an interpreter that has it). The binary ``drake-visualizer`` that the tests start is a stand-in that waits; they
wait for the ready message, which our hub sends to every new subscriber and ``--announce`` sends over UDP.

Two races of the tests, which show on a busy machine, are avoided. A test ends a millisecond after its last request,
with responses still outstanding; here it waits for them. liblcm keeps 30 messages for a thread that is not running and
drops the others; here it keeps all.
"""

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.support.waiting import SECONDS

REPOSITORY = Path(__file__).parents[3]
TESTS = ("testTreeViewerClient.py", "testTreeViewerInterface.py", "testTreeViewerPolyLine.py")
ANSWERS_OF_INTERFACE_TEST = 2000

_SHIM = """
import builtins, collections, collections.abc, runpy, sys, time
import lcm
class Roomy(lcm.LCM):
    def subscribe(self, *values):
        subscription = super().subscribe(*values)
        subscription.set_queue_capacity(0)
        return subscription
lcm.LCM = Roomy
collections.Iterable = collections.abc.Iterable
sys.executable = {executable!r}
heard = []
def note(*values, **options):
    builtins.print(*values, **options)
    heard.extend(value for value in values if value == "ok")
runpy.run_path({test!r}, init_globals={{"sys": sys, "print": note}}, run_name="__main__")
end = time.monotonic() + {seconds}
while len(heard) < {answers} and time.monotonic() < end:
    time.sleep(0.01)
"""
_VISUALIZER = """#!{python}
import os, time
import lcm
from gateway.adapters.treeviewer import responses
if {announce}:
    lcm.LCM().publish("DIRECTOR_TREE_VIEWER_RESPONSE", responses.encode(responses.ReadyMessage()))
time.sleep({seconds})  # until the tests end it
"""


@dataclass(frozen=True)
class Outcome:
    script: str
    status: int
    output: str

    @property
    def ok_answers(self) -> int:
        return self.output.split().count("ok")


@contextlib.contextmanager
def prepared(checkout: Path, script: Path, url: str, *, announce: bool) -> Iterator[tuple[list[str], dict[str, str]]]:
    """Yield the command and the environment that run one script with Director's packages, our type and the shims."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        generator = Path(sys.executable).with_name("lcm-gen")
        types = REPOSITORY / "lcmtypes" / "viewer2_comms_t.lcm"
        subprocess.run([generator, "-p", "--ppath", folder, types], check=True, capture_output=True)
        visualizer = folder / "drake-visualizer"
        visualizer.write_text(_VISUALIZER.format(python=sys.executable, announce=announce, seconds=2 * SECONDS))
        visualizer.chmod(0o755)
        answers = ANSWERS_OF_INTERFACE_TEST + (not announce) if "Interface" in script.name else 0
        shim = _SHIM.format(executable=str(folder / "python"), test=str(script), answers=answers, seconds=SECONDS)
        path = os.pathsep.join(map(str, (folder, checkout / "src" / "python", REPOSITORY)))
        environment = {**os.environ, "PYTHONPATH": path, "LCM_DEFAULT_URL": url, "PYTHONUNBUFFERED": "1"}
        yield [sys.executable, "-c", shim], environment


def run(checkout: Path, script: Path, url: str, *, announce: bool) -> Outcome:
    with prepared(checkout, script, url, announce=announce) as (command, environment):
        done = subprocess.run(
            command,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=2 * SECONDS,
            check=False,
        )
    return Outcome(script.name, done.returncode, done.stdout)


def scripts(checkout: Path) -> list[Path]:
    python = checkout / "src" / "python"
    return [*(python / "tests" / name for name in TESTS), python / "director" / "viewerclient.py"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path)
    parser.add_argument("--url", default="tcpq://127.0.0.1:7700")
    parser.add_argument("--announce", action="store_true")
    arguments = parser.parse_args()
    worst = 0
    for script in scripts(arguments.checkout):
        outcome = run(arguments.checkout, script, arguments.url, announce=arguments.announce)
        good = outcome.status == 0 and "Traceback" not in outcome.output and "unhandled" not in outcome.output
        worst = max(worst, not good)
        print(f"{'ok  ' if good else 'FAIL'} {outcome.script}: {outcome.ok_answers} answers 'ok'")
        if not good:
            print(outcome.output)
    return worst


if __name__ == "__main__":
    raise SystemExit(main())
