"""Two seconds of a simulation of Drake 1.51 with its default visualization (``SCENEGATE_CORPUS``)."""

import io
from pathlib import Path

import numpy as np
import pytest

from gateway.scene.tree.transforms import from_pose
from scenegate.lcm.event_log import Event, read_events
from tests.adapters.drakeviewer.conftest import Viewer
from tests.support.corpus import corpus_dir

pytestmark = pytest.mark.corpus


@pytest.fixture(scope="module")
def events() -> list[Event]:
    log: Path = corpus_dir() / "drakeviewer" / "drake_default.lcmlog"
    if not log.exists():
        pytest.skip(f"{log} is missing")
    # The folder in the names of mesh files was replaced by LABDIR, which is two characters longer than the lengths say.
    return list(read_events(io.BytesIO(log.read_bytes().replace(b"LABDIR", b"/lab"))))


def test_everything_is_shown(viewer: Viewer, events: list[Event]) -> None:
    problems: set[str] = set()
    for event in events:
        problems.update(viewer.handle(event.channel, event.data))
    assert all(problem.startswith("'/lab/") for problem in problems), "the mesh files are not there"
    assert problems
    families = viewer.families()
    assert families["illustration"] == {"links": 25, "draws": 129, "stale": 0, "unloaded": 0}
    assert families["proximity"] == {"links": 14, "draws": 129, "stale": 0, "unloaded": 0}
    for path in (("illustration", "plant", "panda", "panda_hand"), ("proximity", "plant", "panda", "panda_link8")):
        assert viewer.node(*path).parts is not None
    assert viewer.node("inertia", "ball", "ball").parts
    assert viewer.node("contacts", "point", "panda_link5(2)+world(0)").parts
    assert viewer.node("contacts", "hydroelastic", "ball+world").parts


def test_hand_is_where_its_inertia_is(viewer: Viewer, events: list[Event]) -> None:
    """Drake computes both poses; the centre of mass of the hand is 4 cm from its frame in all messages."""
    distances = []
    for event in events:
        viewer.handle(event.channel, event.data)
        if event.channel == "DRAKE_VIEWER_DRAW":
            hand = viewer.node("illustration", "plant", "panda", "panda_hand").pose
            inertia = viewer.node("inertia", "panda", "panda_hand").pose
            assert hand is not None
            assert inertia is not None
            X = np.linalg.inv(from_pose(hand[:3], hand[3:])) @ from_pose(inertia[:3], inertia[3:])
            distances.append(X[:3, 3])
    assert len(distances) == 129
    np.testing.assert_allclose(distances, [distances[0]] * 129, atol=1e-6)
