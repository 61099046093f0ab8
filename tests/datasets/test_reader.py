"""The reader for training jobs."""

import pickle
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

from scenegate.datasets.dataset import Dataset
from scenegate.datasets.lines import Lines
from scenegate.datasets.manifest import MAX_LINE_BYTES, RecordError
from tests.datasets.conftest import SETTINGS, Draw, job_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "read_dataset.py"


def test_the_reader_loads_nothing_of_the_server() -> None:
    code = (
        "import sys, scenegate.datasets.dataset; "
        "print(sorted({m.split('.')[0] for m in sys.modules} & {'numba', 'fastapi', 'grpc', 'renderers', 'lcm'}))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_depth_of_both_formats_is_the_same_to_half_a_millimetre(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    draw(job_of(scenes / "deep", tmp_path / "tiff"))
    png = msgspec.structs.replace(SETTINGS, depth_format="png")
    draw(job_of(scenes / "deep", tmp_path / "png", settings=png))
    for exact, rounded in zip(Dataset(tmp_path / "tiff"), Dataset(tmp_path / "png"), strict=True):
        assert rounded.depth.dtype == np.float32
        seen = np.isfinite(exact.depth)
        assert seen.any()
        assert (np.isfinite(rounded.depth) == seen).all()
        assert np.abs(rounded.depth[seen] - exact.depth[seen]).max() < 0.0006


def test_samples_are_a_sequence(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    draw(job_of(scenes, tmp_path / "out"))
    dataset = Dataset(tmp_path / "out")
    assert [sample.id for sample in dataset[1:3]] == ["a.gltf/orbit-1", "deep/mesh.stl/orbit-0"]
    assert dataset[-1].id == "robot.tree.json/orbit-1"
    with pytest.raises(IndexError):
        _ = dataset[7]
    recorded = next(sample for sample in dataset if sample.record.view == "request")
    with pytest.raises(RecordError, match=r"has no color image, only depth"):
        _ = recorded.color


def test_a_bad_line_is_named_when_it_is_asked_for(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    draw(job_of(scenes, tmp_path / "out"))
    path = tmp_path / "out" / "manifest.jsonl"
    lines = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([lines[0], b'{"id": 1}', *lines[2:], b""]))
    dataset = Dataset(tmp_path / "out")
    assert dataset[0].id == "a.gltf/orbit-0"
    with pytest.raises(RecordError, match=r"manifest.jsonl, line 2: Expected `str`"):
        _ = dataset[1]


@pytest.mark.parametrize(
    ("data", "problem"),
    [(b"a\nb", "line 2: cut off"), (b"a\n" + b"x" * (MAX_LINE_BYTES + 1) + b"\nb\n", "line 2: longer than the limit")],
)
def test_lines_that_are_not_whole(tmp_path: Path, data: bytes, problem: str) -> None:
    (tmp_path / "lines").write_bytes(data)
    with pytest.raises(RecordError, match=problem):
        Lines(tmp_path / "lines")


def test_lines_by_number(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    path.write_bytes(b"")
    assert len(Lines(path)) == 0
    path.write_bytes(b"a\n\nlast\n")
    lines = Lines(path)
    assert [lines[0], lines[1], lines[-1]] == [b"a", b"", b"last"]
    for outside in (3, -4):
        with pytest.raises(IndexError):
            _ = lines[outside]
    saved = pickle.dumps(lines)
    path.write_bytes(b"a\n")
    with pytest.raises(RecordError, match="has changed"):
        pickle.loads(saved)
    with pytest.raises(RecordError, match="No such file"):
        Lines(tmp_path / "none")


def test_no_dataset(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="holds no dataset"):
        Dataset(tmp_path)


def test_the_example(scenes: Path, tmp_path: Path, draw: Draw) -> None:
    for name in ("a.gltf", "depth.multipart", "deep/mesh.stl"):
        (scenes / name).unlink()
    draw(job_of(scenes, tmp_path / "out"))
    command = [sys.executable, str(EXAMPLE), str(tmp_path / "out"), str(tmp_path / "points.npz")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "2 samples of 1 scenes" in done.stdout
    assert "(('robot', 'arm'),)" in done.stdout
    with np.load(tmp_path / "points.npz") as arrays:
        points, labels = arrays["points"], arrays["labels"]
    arm = points[labels == 2]
    assert len(arm) > 3
    assert np.abs(arm[:, :2]).max() < 0.051  # a box of 0.1 x 0.1 x 0.8 m, 0.5 m up
    assert ((arm[:, 2] > 0.09) & (arm[:, 2] < 0.91)).all()
