"""States of a browser's connection, and what each of them may be sent."""

from __future__ import annotations

from gateway.scene.geometry import Part
from gateway.scene.live import LiveTree
from gateway.viewer.encoder import Encoder
from gateway.viewer.flow_control import BrowserState, FlowControl
from gateway.viewer.resources import Resources
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from tests.support.view_frames import parse_frame


def box_tree() -> LiveTree:
    tree = LiveTree()
    with tree.edit() as edit:
        edit.set_parts(("box",), (Part(Box((1, 1, 1)), Material()),))
    return tree


async def first_revision(flow: FlowControl) -> int:
    """Return the revision that the next update starts from."""
    return int(parse_frame((await flow.next_update()).frame)[0]["from"])


async def test_updates_are_due_only_after_an_acknowledgement_and_a_change() -> None:
    tree, encoder = box_tree(), Encoder(Resources())
    flow = FlowControl(encoder)
    due = [flow.update_due]  # new, empty scene
    flow.acknowledge()
    assert flow.state is BrowserState.NEW, "nothing to acknowledge"
    await flow.next_update()
    encoder.advance(tree.snapshot)
    due.append(flow.update_due)  # busy
    flow.acknowledge()
    due.append(flow.update_due)  # ready, changed
    await flow.next_update()
    flow.acknowledge()
    due.append(flow.update_due)  # ready, unchanged
    flow.state = BrowserState.CLOSED
    encoder.advance(box_tree().snapshot)
    flow.acknowledge()
    due.append(flow.update_due)
    assert due == [True, False, True, False, False]
    assert flow.state is BrowserState.CLOSED


async def test_only_a_busy_page_loses_its_snapshot() -> None:
    tree, encoder = box_tree(), Encoder(Resources())
    encoder.advance(tree.snapshot)
    flow = FlowControl(encoder)
    await flow.next_update()
    flow.acknowledge()
    flow.drop_snapshot()
    assert await first_revision(flow) == tree.snapshot.revision
    flow.drop_snapshot()
    flow.acknowledge()
    assert flow.update_due
    assert await first_revision(flow) == 0


async def test_meshes_are_missing_once_and_dropped_once() -> None:
    tree, encoder = box_tree(), Encoder(Resources())
    encoder.advance(tree.snapshot)
    flow = FlowControl(encoder)
    update = await flow.next_update()
    (mesh,) = flow.take_missing_meshes(update)
    assert flow.take_missing_meshes(update) == []
    flow.remove_meshes({mesh + 1})
    assert flow.take_forget_frame() is None
    flow.remove_meshes({mesh, mesh + 1})
    frame = flow.take_forget_frame()
    assert frame is not None
    assert parse_frame(frame)[0]["meshes"] == [mesh]
    assert flow.take_forget_frame() is None
    assert flow.take_missing_meshes(update) == [mesh]
