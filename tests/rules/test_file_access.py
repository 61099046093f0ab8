"""Files are read by ``scenegate.regular_files`` only: a named pipe or a device must not hang a command."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDERS = (ROOT / "gateway", ROOT / "client" / "scenegate")
READERS = {"read_bytes", "read_text", "imread", "load", "fdopen", "open"}
ALLOWED = {
    "regular_files.py": "the module itself",
    "runtime/workers/limited_process_child.py": "/proc/self/statm",
    "runtime/kernels/cache.py": "the kernel cache's own lock",
    "runtime/workers/worker_reports.py": "files of our own processes",
    "cli/serve_workers.py": "the folder that it locks",
    "runtime/workers/scheduling.py": "/proc and /sys",
    "lcm/udpm_socket.py": "/proc",
    "lcm/liblcm_transport.py": "/dev/null",
    "runtime/state/database.py": "checks by itself that the file is regular, since it writes it",
    "adapters/viewer/routes.py": "the page, a part of this package",
    "replay/page_file.py": "the page, a part of this package",
    "adapters/stereo/imaging/recorded_pairs.py": "np.load of an open regular file",
    "cli/standard_streams.py": "/dev/null",
    "testing/gateway.py": "its own log",
    "files/parsers/texture_files.py": "bytes in memory",
    "datasets/dataset.py": "bytes in memory",
    "datasets/files.py": "folders, and files that it writes",
    "datasets/run.py": "the journal, which it writes",
    "datasets/formats/coco_format.py": "the file that it writes",
    "adapters/render/failures.py": "files that it writes",
    "lcm/replay.py": "the log, which it writes; reading is by open_regular",
    "recording/mcap_file.py": "the files that it writes",
    "recording/ros2_messages.py": "definitions of messages, a part of this package",
}
"""Files that may open others, and what."""


def reads(path: Path) -> list[str]:
    """Return the calls that may read a file: methods and functions of these names with a path."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Call):
            continue
        function = node.func
        if isinstance(function, ast.Attribute):
            name, owner = function.attr, ast.unparse(function.value)
        elif ast.unparse(function) == "open":
            name, owner = "open", ""
        else:  # functions of regular_files, too
            continue
        if name == "load" and owner not in ("np", "numpy", "json", "tomllib", "pickle"):
            continue
        if name in READERS and owner != "webbrowser":
            found.append(f"{name}, line {node.lineno}")
    return found


def test_files_are_opened_in_one_place() -> None:
    found = {path.relative_to(folder).as_posix(): reads(path) for folder in FOLDERS for path in folder.rglob("*.py")}
    others = {name: calls for name, calls in found.items() if calls and name not in ALLOWED}
    assert not others, "use scenegate.regular_files"
    assert not [name for name in ALLOWED if not found[name]], "these open no file any more"
