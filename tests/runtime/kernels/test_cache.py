"""The kernel cache: its folder, when it is complete, and when old folders are removed."""

import asyncio
import fcntl
import json
import os
import pickle
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

import pytest
import uvloop

from gateway.runtime.kernels import cache as kernels
from gateway.runtime.kernels import parts
from gateway.runtime.kernels.progress import KernelProgress
from renderers.compiler import cache_folder
from renderers.compiler.cache_locator import watch_compiler
from renderers.compiler.jit import KERNELS
from tests.support.locks import refuse_locks
from tests.support.waiting import until

KERNEL = "renderers.fxaa.smooth_rows"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("SCENEGATE_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")  # configure() writes it; monkeypatch takes it back
    clear_memory()
    yield tmp_path
    clear_memory()


def clear_memory() -> None:
    """Clear what the process remembers about the cache, as in a new process."""
    cache_folder.root.cache_clear()
    cache_folder._platform_digest.cache_clear()  # noqa: SLF001 - its results live as long as the process


def write_kernel() -> Path:
    """Write the files of a part with one kernel and the manifest of them; return the kernel's folder."""
    folder = kernels.configure() / KERNEL
    folder.mkdir(parents=True)
    (folder / "fxaa.smooth_rows-1.py311.nbi").write_bytes(b"index")
    (folder / "fxaa.smooth_rows-1.py311.1.nbc").write_bytes(b"machine code")
    cache_folder.write_manifest({"rest": [KERNEL]})
    return folder


def test_the_folder_is_in_the_cache_and_passed_to_numba(cache: Path) -> None:
    folder = kernels.configure()
    assert folder.parent == cache / "kernels"
    assert os.environ["NUMBA_CACHE_DIR"] == str(folder.parent)
    assert cache_folder.sources_digest() in folder.name


def test_the_folder_of_numba_cache_dir_is_used(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache / "mine"))
    assert kernels.configure().parent == cache / "mine"


def test_complete_while_no_file_changes(cache: Path) -> None:
    assert not kernels.are_cached()
    folder = write_kernel()
    assert kernels.are_cached()
    assert cache_folder.count() == 1
    os.utime(folder / "fxaa.smooth_rows-1.py311.nbi", (0, 0))  # times do not matter
    assert kernels.are_cached()


@pytest.mark.parametrize("suffix", ["nbi", "1.nbc"])
@pytest.mark.parametrize("change", ["remove", "truncate"])
def test_not_complete_when_a_file_is_missing_or_changed(cache: Path, suffix: str, change: str) -> None:
    file = write_kernel() / f"fxaa.smooth_rows-1.py311.{suffix}"
    file.unlink() if change == "remove" else file.write_bytes(file.read_bytes()[:-1])
    assert not kernels.are_cached()
    expected = f"1 of 2 files are missing or changed, the first is {KERNEL}/{file.name}"
    assert cache_folder.missing() == expected


def test_complete_when_an_index_lists_more(cache: Path) -> None:
    """Another program has compiled a further specialisation of the same kernel."""
    index = write_kernel() / "fxaa.smooth_rows-1.py311.nbi"
    stamp = cache_folder.sources_digest()
    overloads = {"first": "fxaa.smooth_rows-1.py311.1.nbc", "second": "another.2.nbc"}
    pickled = pickle.dumps("0.1") + pickle.dumps((stamp, overloads))
    index.write_bytes(pickled)
    assert kernels.are_cached()
    other_file, other_stamp = pickled.replace(b".1.nbc", b".3.nbc"), pickled.replace(stamp.encode(), b"0" * 16)
    for wrong in (pickled[:-1], other_file, other_stamp, bytes(8) + pickled[8:], pickled + bytes(8)):
        index.write_bytes(wrong)
        assert not kernels.are_cached()


async def test_a_damaged_kernel_is_deleted_before_it_is_compiled(
    cache: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def compile_in_children(parts: Collection[str], *_: object) -> None:
        assert list(parts) == ["rest"]
        left.extend(path.name for path in folder.iterdir())

    left: list[str] = []
    folder = write_kernel()
    (folder / "fxaa.smooth_rows-1.py311.nbi").write_bytes(bytes(5))
    monkeypatch.setattr(kernels, "compile_in_children", compile_in_children)
    await kernels.compile_missing(["rest"], KernelProgress({"rest": 1}))
    assert left == []
    assert [record.args for record in caplog.records] == [(cache_folder.folder(), KERNEL)]


async def test_a_damaged_kernel_that_cannot_be_deleted_is_an_error(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, *, missing_ok: bool) -> None:
        raise PermissionError(13, "Permission denied")

    (write_kernel() / "fxaa.smooth_rows-1.py311.nbi").write_bytes(bytes(5))
    monkeypatch.setattr(Path, "unlink", refuse)
    with pytest.raises(kernels.KernelError, match=r"Permission denied\): .* NUMBA_CACHE_DIR$"):
        await kernels.compile_missing(["rest"], KernelProgress({"rest": 1}))


@pytest.mark.parametrize("content", ["", "\0" * 100, "[]", "null", '{"rest": 5}', "[" * 100_000])
def test_a_damaged_list_is_written_anew(cache: Path, content: str) -> None:
    folder = kernels.configure()
    folder.mkdir(parents=True)
    (folder / "complete.json").write_text(content)
    assert cache_folder.missing() == "complete.json cannot be read"
    assert cache_folder.remove_damaged() == []
    write_kernel()
    assert kernels.are_cached()


def test_complete_for_one_kind_of_cpu(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Several machines may share a home directory, and Numba can compile for another CPU."""
    write_kernel()
    monkeypatch.setenv("NUMBA_CPU_NAME", "nehalem")
    assert not kernels.are_cached()
    write_kernel()
    assert kernels.are_cached()
    monkeypatch.delenv("NUMBA_CPU_NAME")
    assert kernels.are_cached()
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_name", lambda: "haswell")
    clear_memory()
    assert not kernels.are_cached()


def test_complete_for_all_cpus_that_have_the_features_of_numbas_settings(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CPU_NAME", "x86-64-v3")
    monkeypatch.setenv("NUMBA_CPU_FEATURES", "")
    write_kernel()
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_name", lambda: "haswell")
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_features", dict)
    clear_memory()
    assert kernels.are_cached()


@pytest.mark.parametrize("package", ["numba", "llvmlite", "numpy"])
def test_complete_for_one_version_of_the_compiler(cache: Path, monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    write_kernel()
    monkeypatch.setattr(cache_folder, "version", lambda name: "0.0" if name == package else "1.0")
    clear_memory()
    assert not kernels.are_cached()


KERNEL_MODULE = "from gateway.scene.numbers import N\nfrom renderers.compiler.jit import kernel\n"


def test_the_digest_depends_on_contents_and_not_on_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def digest(tree: Path) -> str:
        class Spec:
            def __init__(self, package: str) -> None:
                self.submodule_search_locations = [str(tree / package)]

        monkeypatch.setattr(cache_folder, "find_spec", Spec)
        return cache_folder.sources_digest.__wrapped__()

    def write(tree: Path, name: str, text: str) -> None:
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_text(text)

    trees = [tmp_path / "one", tmp_path / "two"]
    for tree in trees:
        write(tree, "renderers/a.py", "1")
        write(tree, "gateway/scene/kernels.py", KERNEL_MODULE)
        write(tree, "gateway/scene/numbers.py", "N = 1")
        write(tree, "gateway/other.py", "")
    first, second = trees
    same = digest(first)
    os.utime(second / "renderers/a.py", (0, 0))
    write(second, "gateway/other.py", "no kernel sees it")
    assert digest(second) == same
    for name in ("renderers/a.py", "renderers/b.py", "gateway/scene/kernels.py", "gateway/scene/numbers.py"):
        before = digest(second)
        write(second, name, f"# changed\n{KERNEL_MODULE}")
        assert digest(second) != before


def test_a_changed_kernel_of_the_gateway_changes_the_digest(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise a new version of Scenegate would run the machine code of an old one."""
    parts.PARTS["formats"].compile_or_load()
    files = {Path(k.py_func.__code__.co_filename) for k in KERNELS if k.py_func.__module__.startswith("gateway.")}
    assert len(files) > 3
    read_bytes = Path.read_bytes
    same = cache_folder.sources_digest.__wrapped__()
    for changed in files:
        monkeypatch.setattr(
            Path, "read_bytes", lambda path, changed=changed: read_bytes(path) + (b"#" if path == changed else b"")
        )
        assert cache_folder.sources_digest.__wrapped__() != same, changed


def test_the_oldest_folders_are_removed(cache: Path) -> None:
    for age in range(7):
        old = cache / "kernels" / f"scenegate-old{age}"
        old.mkdir(parents=True)
        os.utime(old, (1e9 - age, 1e9 - age))
    (cache / "kernels" / "of_another_program").mkdir()
    write_kernel()
    left = sorted(path.name for path in (cache / "kernels").glob("*old*"))
    assert left == [f"scenegate-old{age}" for age in range(4)]
    assert (cache / "kernels" / "of_another_program").is_dir()
    assert kernels.are_cached()


def test_a_private_folder_replaces_one_that_cannot_be_written(cache: Path) -> None:
    blocked = cache / "kernels"
    blocked.write_text("a file where a folder should be")
    folder = kernels.configure()
    assert folder.parent.is_dir()
    assert stat.S_IMODE(folder.parent.stat().st_mode) == 0o700


def test_a_complete_folder_is_used_although_it_cannot_be_written(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_kernel().parent
    monkeypatch.setattr(cache_folder, "unusable", lambda path: "which cannot be written")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    clear_memory()
    assert kernels.configure() == folder
    assert kernels.are_cached()


@pytest.mark.parametrize(
    ("variable", "reason"),
    [
        ("NUMBA_CACHE_DIR", "/proc/none/.* cannot be written: "),
        ("SCENEGATE_CACHE_DIR", "/proc/none/kernels/.* cannot be written"),  # nor is there a place for a private one
        ("", "1 MB free .*16 MB"),
    ],
)
async def test_a_folder_that_cannot_be_filled_is_an_error_before_anything_is_compiled(
    cache: Path, monkeypatch: pytest.MonkeyPatch, variable: str, reason: str
) -> None:
    if variable:
        monkeypatch.setenv(variable, "/proc/none")
        monkeypatch.setattr(tempfile, "tempdir", "/proc/none")
    else:
        monkeypatch.setattr(shutil, "disk_usage", lambda path: (1 << 30, 1 << 30, 1 << 20))
    with pytest.raises(kernels.KernelError, match=reason):
        await kernels.compile_missing(["shading"], KernelProgress({"shading": 1}))


@pytest.mark.parametrize(("commands", "reason"), [("exit 1", "exit code 1$"), ("kill -KILL $$", "killed, .*memory")])
async def test_a_child_that_fails_is_an_error_of_one_sentence(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, commands: str, reason: str
) -> None:
    monkeypatch.setattr(sys, "executable", script(tmp_path, commands))
    with pytest.raises(kernels.KernelError, match=reason):
        await kernels.compile_in_children(["shading"], KernelProgress({"shading": 1}))
    assert not kernels.are_cached()


async def test_cancelled_twice_while_children_compile(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As when a child fails and the process is stopped."""
    report, pid = json.dumps({"part": "shading"}), tmp_path / "pid"
    commands = f"echo $$ >{pid}; echo '{report}'; exec sleep 1000"
    monkeypatch.setattr(sys, "executable", script(tmp_path, commands))
    progress = KernelProgress({"shading": 9})
    task = asyncio.create_task(kernels.compile_in_children(["shading"], progress))
    await until(lambda: progress.compiled)
    task.cancel()
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)


@pytest.mark.parametrize("run", [asyncio.run, uvloop.run], ids=["commands", "server"])
def test_ctrl_c_does_not_reach_a_child(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Callable[[Any], Any]
) -> None:
    """A terminal sends the signal to a process group. A child that it ended was reported as kernels that fail."""
    child = tmp_path / "child"
    child.write_text(f"#!{sys.executable}\nimport os, sys\nsys.exit(f'in group {{os.getpgrp()}}')\n")
    child.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(child))
    with pytest.raises(kernels.KernelError, match=r"in group \d+$") as error:
        run(kernels.compile_in_children(["shading"], KernelProgress({"shading": 1})))
    assert int(str(error.value).split()[-1]) != os.getpgrp()


def script(folder: Path, commands: str) -> str:
    """Write a program that does not look at its arguments; return its path."""
    program = folder / "program"
    program.write_text(f"#!/bin/sh\n{commands}\n")
    program.chmod(0o755)
    return str(program)


@pytest.mark.slow
async def test_children_import_what_this_process_does(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An installed Scenegate may be started in a clone of another version."""
    (tmp_path / "gateway").mkdir()
    (tmp_path / "gateway" / "__init__.py").write_text("raise ImportError('another version')")
    monkeypatch.chdir(tmp_path)
    await kernels.compile_in_children(["normals"], KernelProgress({"normals": 1}))
    assert kernels.are_cached(["normals"])


async def test_of_two_processes_one_compiles(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = 0

    async def compile_in_children(
        parts: Collection[str], progress: KernelProgress, on_cached: kernels.OnCached
    ) -> None:
        nonlocal compiled
        compiled += 1
        await until(lambda: second.waiting)
        write_kernel()
        for part in parts:
            await on_cached(part)

    async def note(part: str) -> None:
        cached.append(part)

    cached: list[str] = []
    monkeypatch.setattr(kernels, "compile_in_children", compile_in_children)
    first, second = KernelProgress({"rest": 1}), KernelProgress({"rest": 1})
    task = asyncio.create_task(kernels.compile_missing(["rest"], first, note))
    await until(lambda: compiled)
    await asyncio.gather(task, kernels.compile_missing(["rest"], second, note))
    assert compiled == 1
    assert not second.waiting
    assert cached == ["rest", "rest"]


async def test_cancelled_while_waiting_for_another_process(cache: Path) -> None:
    folder = kernels.configure()
    folder.mkdir(parents=True)
    progress = KernelProgress({"rest": 1})
    with (folder / "lock").open("wb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        task = asyncio.create_task(kernels.compile_missing(["rest"], progress))
        await until(lambda: progress.waiting)
        described = progress.describe()
        assert described["waiting"] == "another process compiles the kernels"
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task


async def test_a_cache_folder_without_locks_is_filled(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def compile_in_children(
        parts: Collection[str], progress: KernelProgress, on_cached: kernels.OnCached
    ) -> None:
        compiled.extend(parts)

    compiled: list[str] = []
    monkeypatch.setattr(kernels, "compile_in_children", compile_in_children)
    refuse_locks(monkeypatch)
    progress = KernelProgress({"rest": 1})
    await kernels.compile_missing(["rest"], progress)
    assert compiled == ["rest"]
    assert not progress.waiting


def _fresh() -> Any:
    from numba import njit

    jit: Any = njit  # its stubs know no functions that call others

    def add_one(x: int) -> int:
        return x + 1

    called = jit(add_one)

    def fresh(x: int) -> Any:
        return called(x)

    return jit(fresh)


def test_compiling_is_refused_while_kernels_are_loaded(cache: Path) -> None:
    write_kernel()
    fresh = _fresh()
    with kernels.forbid_compiling():
        with pytest.raises(
            kernels.KernelError, match=r"^the kernel tests.runtime.kernels.test_cache._fresh.*fresh could not be"
        ):
            fresh(1)
        with pytest.raises(kernels.KernelError):
            fresh(1)
    assert not kernels.are_cached()  # the manifest was wrong
    assert fresh(1) == 2


def test_compiling_is_reported_with_the_called_function(cache: Path) -> None:
    compiled: list[str] = []
    with watch_compiler(lambda name, depth: compiled.append(f"{name.rsplit('.', 1)[1]} {depth}")):
        assert _fresh()(1) == 2
    assert _fresh()(1) == 2
    assert compiled == ["fresh 1", "add_one 2"]
