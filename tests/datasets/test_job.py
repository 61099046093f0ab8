"""Samples and tasks of a job."""

from pathlib import Path

import pytest

from gateway.datasets.job import VIEWS_PER_TASK, Job, PlannedSample, make_job
from gateway.datasets.scene_sources import Source, SourceKind
from gateway.datasets.views import CameraFile, View
from scenegate.datasets.manifest import FailureRecord
from tests.datasets.conftest import SETTINGS

MESH = Source("mesh.stl", "/mesh.stl", SourceKind.FILE)
REQUEST = Source("a/request.multipart", "/request.multipart", SourceKind.REQUEST)
SPECIAL = Source("special.glb", "/special.glb", SourceKind.FILE)
VIEWS = tuple(View(f"v{k}", "fit") for k in range(VIEWS_PER_TASK + 2))
OWN_VIEWS = (View("own", "fit"),)


@pytest.fixture
def job() -> Job:
    overrides = {"special.glb": OWN_VIEWS}
    return Job((REQUEST, MESH, SPECIAL), VIEWS, overrides, SETTINGS, Path("/out"), timeout=7.0)  # short: never waited


def test_samples_are_numbered_in_the_order_of_scenes_and_views(job: Job) -> None:
    assert job.size == 1 + len(VIEWS) + 1
    assert job.find("a/request.multipart/request") == PlannedSample(0, REQUEST, job.views_of(REQUEST)[0])
    assert job.find("mesh.stl/v0") == PlannedSample(1, MESH, VIEWS[0])
    assert job.find("mesh.stl/v17") == PlannedSample(18, MESH, VIEWS[17])
    assert job.find("special.glb/own") == PlannedSample(19, SPECIAL, OWN_VIEWS[0])


@pytest.mark.parametrize("sample_id", ["mesh.stl/own", "special.glb/v0", "other.stl/v0", "mesh.stl", "", "v0"])
def test_samples_that_are_not_part_of_the_job(job: Job, sample_id: str) -> None:
    assert job.find(sample_id) is None


def test_tasks_are_of_one_scene_and_limited_in_views(job: Job) -> None:
    tasks = job.tasks(lambda number: False, "digest")
    sizes = [(task.source, len(task.samples)) for task in tasks]
    assert sizes == [(REQUEST, 1), (MESH, VIEWS_PER_TASK), (MESH, 2), (SPECIAL, 1)]
    assert tasks[1].samples + tasks[2].samples == tuple(PlannedSample(k, MESH, view) for k, view in enumerate(VIEWS, 1))
    assert {(task.out, task.settings, task.renderer_digest, task.threads, task.timeout) for task in tasks} == {
        ("/out", SETTINGS, "digest", 1, 7.0)
    }


def test_tasks_leave_out_samples_that_exist(job: Job) -> None:
    tasks = job.tasks(lambda number: number not in (2, 18), "digest")
    assert [(task.source, [sample.view.name for sample in task.samples]) for task in tasks] == [(MESH, ["v1", "v17"])]


def test_scenes_with_unusable_names_have_numbers_but_no_tasks() -> None:
    bad = Source("bad", "/bad", SourceKind.FILE, problem="a bad name")
    job = Job((bad, MESH), VIEWS[:2], {}, SETTINGS, Path("/out"))
    assert job.find("mesh.stl/v0") == PlannedSample(2, MESH, VIEWS[0])
    assert [task.source for task in job.tasks(lambda number: number < 3, "")] == [MESH]


def test_without_views_each_scene_has_one() -> None:
    job = make_job((MESH,), (), CameraFile(), SETTINGS, Path("/out"))
    assert job.default_views == (View("default", None),)
    assert job.timeout == 0.0


def test_views_of_the_command_come_before_those_of_the_camera_file() -> None:
    cameras = CameraFile((View("c", "fit"),), {"special.glb": OWN_VIEWS})
    job = make_job((MESH, SPECIAL), (View("b", "fit"),), cameras, SETTINGS, Path("/out"), 2.0)
    assert [view.name for view in job.views_of(MESH)] == ["b", "c"]
    assert job.views_of(SPECIAL) == OWN_VIEWS
    assert job.timeout == 2.0


def test_a_failed_task_is_a_failure_of_each_view(job: Job) -> None:
    result = job.tasks(lambda number: number != 1, "")[0].failed("no memory")
    assert result.failures == [FailureRecord("mesh.stl", "v0", "no memory")]
    assert result.samples == []
