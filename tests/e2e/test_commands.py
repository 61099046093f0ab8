"""The other commands as a user types them."""

from __future__ import annotations

import subprocess
import sys

from gateway import __version__


def scenegate(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    import os

    return subprocess.run(
        [sys.executable, "-m", "gateway.cli", *arguments],
        env={**os.environ, "COLUMNS": "200", **environment},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def test_version() -> None:
    assert scenegate("--version").stdout == f"scenegate {__version__}\n"


def test_help_of_serve_lists_every_setting_once() -> None:
    from gateway.settings import Settings, flag_of

    text = scenegate("serve", "--help").stdout
    for name in Settings.model_fields:
        assert f"{flag_of(name)} " in text or f"{flag_of(name)}," in text, name


def test_check_is_one_table_and_needs_no_kernels() -> None:
    result = scenegate("check", SCENEGATE_HTTP_PORT="0", SCENEGATE_TCPQ_PORT="0")
    assert result.returncode == 0, result.stdout + result.stderr
    for word in ("scenegate", "Python", "numba", "threads", "kernels", "multicast", "receive buffer"):
        assert any(line.startswith(word) for line in result.stdout.splitlines()), word


def test_check_says_what_is_wrong() -> None:
    import socket

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = scenegate("check", SCENEGATE_HTTP_PORT=str(port))
    assert result.returncode == 1
    assert f"HTTP: another program listens there (127.0.0.1 port {port})" in result.stdout


def test_starting_the_command_line_imports_no_renderer() -> None:
    code = "import gateway.cli, sys; print(sorted({'numba', 'cv2', 'fastapi', 'grpc'} & sys.modules.keys()))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout == "[]\n"
