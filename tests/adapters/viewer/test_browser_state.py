"""States of a browser's connection, and what each of them may be sent."""

from gateway.adapters.viewer.browser import Browser, BrowserState
from gateway.adapters.viewer.encoder import Encoder
from gateway.adapters.viewer.resources import Resources
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from tests.adapters.viewer.model import browser_of
from tests.support.view_frames import parse_frame


def box_tree() -> LiveTree:
    tree = LiveTree()
    with tree.edit() as edit:
        edit.set_parts(("box",), (Part(Box((1, 1, 1)), Material()),))
    return tree


async def first_revision(browser: Browser) -> int:
    """Return the revision that the next update starts from."""
    return int(parse_frame((await browser.next_update()).frame)[0]["from"])


async def test_updates_are_due_only_after_an_acknowledgement_and_a_change() -> None:
    tree, encoder = box_tree(), Encoder(Resources())
    browser = browser_of(encoder, Resources())
    due = [browser.update_due]  # new, empty scene
    browser.acknowledge()
    assert browser.state is BrowserState.NEW, "nothing to acknowledge"
    await browser.next_update()
    encoder.advance(tree.snapshot)
    due.append(browser.update_due)  # busy
    browser.acknowledge()
    due.append(browser.update_due)  # ready, changed
    await browser.next_update()
    browser.acknowledge()
    due.append(browser.update_due)  # ready, unchanged
    browser.state = BrowserState.CLOSED
    encoder.advance(box_tree().snapshot)
    browser.acknowledge()
    due.append(browser.update_due)
    assert due == [True, False, True, False, False]
    assert browser.state is BrowserState.CLOSED


async def test_only_a_busy_page_loses_its_snapshot() -> None:
    tree, encoder = box_tree(), Encoder(Resources())
    encoder.advance(tree.snapshot)
    browser = browser_of(encoder, Resources())
    await browser.next_update()
    browser.acknowledge()
    browser.drop_snapshot_if_sent_before(1.0)
    assert await first_revision(browser) == tree.snapshot.revision
    browser.drop_snapshot_if_sent_before(1.0)
    browser.acknowledge()
    assert browser.update_due
    assert await first_revision(browser) == 0


async def test_meshes_are_missing_once_and_dropped_once() -> None:
    tree, encoder = box_tree(), Encoder(Resources())
    encoder.advance(tree.snapshot)
    browser = browser_of(encoder, Resources())
    update = await browser.next_update()
    (mesh,) = browser.take_missing_meshes(update)
    assert browser.take_missing_meshes(update) == []
    browser.remove_meshes({mesh + 1})
    assert browser.take_forget_frame() is None
    browser.remove_meshes({mesh, mesh + 1})
    frame = browser.take_forget_frame()
    assert frame is not None
    assert parse_frame(frame)[0]["meshes"] == [mesh]
    assert browser.take_forget_frame() is None
    assert browser.take_missing_meshes(update) == [mesh]
