"""What the commands print and return; the work behind them is replaced."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from gateway import __version__
from gateway.cli import dataset, doctor, render_dataset
from gateway.cli.commands import app
from gateway.datasets import check as dataset_check
from gateway.runtime.kernels import cache
from gateway.runtime.logs import log_setup
from scenegate.cli import SERVER_COMMANDS
from scenegate.cli.play import STATE_CHANNELS
from scenegate.datasets.manifest import FailureRecord
from scenegate.lcm import replay
from scenegate.lcm.event_log import EventLogError, Section
from tests.support.command import scenegate
from tests.support.waiting import SECONDS


@pytest.fixture(autouse=True)
def _process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_setup, "configure", lambda *_: None)
    monkeypatch.setattr(cache, "configure", lambda: Path("kernels"))
    monkeypatch.setattr("signal.signal", lambda *_: None)


def invoke(*arguments: str) -> Any:
    """Run a command of the client, or one of the server."""
    return CliRunner().invoke(app, arguments) if arguments[0] in SERVER_COMMANDS else scenegate(*arguments)


def test_the_version() -> None:
    result = invoke("--version")
    assert (result.exit_code, result.stdout) == (0, f"scenegate {__version__}\n")


@pytest.mark.parametrize(("usable", "code"), [(True, 0), (False, 1)])
def test_the_exit_code_of_doctor(usable: bool, code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "print_findings", lambda: usable)
    assert invoke("doctor").exit_code == code


@pytest.mark.parametrize("seconds", ["0.01", "0"])
def test_recording_ends_after_its_time(seconds: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[Any, ...]] = []

    async def record(
        out: Path, url: str | None, channels: str, progress: replay.LogProgress, stop: asyncio.Event, on_ready: Any
    ) -> None:
        calls.append((out, url, channels))
        on_ready()
        progress.events, progress.data_bytes, progress.lost = 3, 70, "2 datagrams"
        if seconds != "0":
            async with asyncio.timeout(SECONDS):
                await stop.wait()
        assert stop.is_set() == (seconds != "0")

    monkeypatch.setattr(replay, "record", record)
    out = tmp_path / "x.lcmlog"
    result = invoke("record", str(out), "--seconds", seconds, "--channels", "A.*", "--lcm-url", "memq://")
    assert result.exit_code == 0
    assert result.stderr.startswith(f"Recording ...\n{out}: 3 messages, 70 bytes\n")
    assert "2 datagrams" in result.stderr
    assert calls == [(out, "memq://", "A.*")]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], replay.PlayOptions(section=Section(state_channels=STATE_CHANNELS))),
        (
            ["--rate", "0", "--loop", "--channels", "A", "--start", "2.5", "--duration", "3"],
            replay.PlayOptions(0.0, Section(2.5, 3.0, STATE_CHANNELS), True, "A"),
        ),
    ],
)
def test_playing_a_log(
    arguments: list[str], expected: replay.PlayOptions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[replay.PlayOptions] = []

    async def play(log: Path, url: str | None, playback: replay.PlayOptions, progress: replay.LogProgress) -> None:
        calls.append(playback)
        progress.events, progress.data_bytes, progress.lost = 3, 70, "2 datagrams"
        if playback.loop:
            raise KeyboardInterrupt

    monkeypatch.setattr(replay, "play", play)
    log = tmp_path / "x.lcmlog"
    log.write_bytes(b"")
    result = invoke("play", str(log), *arguments)
    assert (result.exit_code, result.stderr) == (0, f"{log}: 3 messages played, 70 bytes\n")
    assert calls == [expected]


def test_a_file_that_is_no_log_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def play(*_: Any) -> None:
        raise EventLogError("it has no events")

    monkeypatch.setattr(replay, "play", play)
    log = tmp_path / "x.lcmlog"
    log.write_bytes(b"")
    assert invoke("play", str(log)).stderr == f"scenegate: {log}: it has no events\n"
    assert invoke("play", str(log), "--rate", "-1").exit_code == 2
    assert invoke("play", str(tmp_path / "none")).exit_code == 2
    assert invoke("play", str(tmp_path)).exit_code == 2
    assert invoke("convert", str(tmp_path), str(tmp_path / "out.mcap")).exit_code == 2


@pytest.mark.parametrize(
    ("notes", "problems", "code"), [(0, 0, 0), (2, 0, 0), (0, 1, 1), (dataset.MAX_SHOWN, dataset.MAX_SHOWN + 2, 1)]
)
def test_a_checked_dataset(
    notes: int, problems: int, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads: list[int] = []

    def check_dataset(_: Path, count: int, show: Callable[[int, int], None]) -> Any:
        threads.append(count)
        show(2, 4)
        said = {"notes": [f"n{k}" for k in range(notes)], "problems": [f"p{k}" for k in range(problems)]}
        return SimpleNamespace(**said, samples=4, scenes=2, images=8, image_bytes=1_250_000)

    monkeypatch.setattr(dataset_check, "check_dataset", check_dataset)
    monkeypatch.setattr("gateway.runtime.workers.scheduling.usable_cpus", lambda: 7)
    result = invoke("dataset", "check", str(tmp_path))
    assert result.exit_code == code
    assert result.stdout == f"{tmp_path}: 4 samples of 2 scenes, 8 images, 1.2 MB, {problems} problems\n"
    lines = [f"note: n{k}" for k in range(min(notes, dataset.MAX_SHOWN))]
    lines += [f"scenegate: p{k}" for k in range(min(problems, dataset.MAX_SHOWN))]
    lines += [f"... and {problems - dataset.MAX_SHOWN} more problems"] * (problems > dataset.MAX_SHOWN)
    assert result.stderr.splitlines() == lines
    invoke("dataset", "check", str(tmp_path), "--threads", "3")
    assert threads == [7, 3]
    assert invoke("dataset", "check", str(tmp_path), "--threads", "-1").exit_code == 2


def run_job(monkeypatch: pytest.MonkeyPatch, steps: Callable[[Any, Any], Any]) -> Any:
    """Return a job; ``steps`` replaces its run."""
    monkeypatch.setattr(render_dataset, "run", lambda job, execute, report: steps(execute, report))
    return SimpleNamespace(size=3, out=Path("out"))


def progress(failures: int = 0, warnings: dict[str, list[str]] | None = None, finished: int = 3) -> Any:
    failed = [FailureRecord(f"s{k}", None if k % 2 else "view", "broken") for k in range(failures)]
    counts = {"finished": finished, "total": 3, "kept": 1, "rendered": 2}
    return SimpleNamespace(failures=failed, warnings=warnings or {}, notes=["repaired"], **counts)


@pytest.mark.parametrize("failures", [0, 2])
def test_the_result_of_a_dataset(failures: int, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    done = progress(failures, {"b": ["odd"], "a": ["x", "y"]})
    executes: list[Any] = []

    def steps(execute: Any, report: Any) -> Any:
        executes.append(execute)
        report(done)
        return done

    job = run_job(monkeypatch, steps)
    assert render_dataset.render_dataset(job, 4, None) == (failures == 0)
    assert render_dataset.render_dataset(job, 4, "auto") == (failures == 0)
    assert [(execute.func.__name__, execute.keywords) for execute in executes] == [
        ("run_local", {"cores": 4}),
        ("run_ray", {"address": "auto"}),
    ]
    lines = capsys.readouterr().err.splitlines()
    lines = lines[: len(lines) // 2]
    assert lines[:4] == ["out: repaired", "a: x", "a: y", "b: odd"]
    assert lines[4:-1] == ["scenegate: s0, view: broken", "scenegate: s1: broken"][:failures]
    assert lines[-1].startswith("out: 3 of 3 samples, 1 of them from before, 2 rendered in 0.")
    assert ("; 2 problems, see " in lines[-1]) == (failures == 2)


def test_a_stopped_dataset_can_go_on(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    def steps(*_: Any) -> Any:
        raise KeyboardInterrupt

    with pytest.raises(typer.Exit) as ended:
        render_dataset.render_dataset(run_job(monkeypatch, steps), 1, None)
    assert ended.value.exit_code == 130
    assert capsys.readouterr().err == "Stopped. The same command goes on from here.\n"


def test_a_log_gets_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])

    def steps(_: Any, report: Any) -> Any:
        for seconds, failures in ((0.0, 0), (render_dataset.LOG_SECONDS, 0), (0.1, 0), (1.0, 0)):
            now[0] += seconds
            report(progress(failures, finished=2))
        now[0] += render_dataset.LOG_SECONDS + 0.1
        report(progress(1))
        return progress()

    render_dataset.render_dataset(run_job(monkeypatch, steps), 1, None)
    lines = capsys.readouterr().err.splitlines()
    assert lines[:2] == ["2 of 3 done, 0.2/s, 0:00:05 left ", "3 of 3 done, 0.1/s, 0:00:00 left 1 failed"]
    assert len(lines) == 4
