"""States of a browser's connection, and what each of them may be sent."""

from gateway.adapters.viewer.browser import Browser
from gateway.adapters.viewer.encoder import Encoder
from gateway.adapters.viewer.resources import Resources
from tests.adapters.viewer.model import box_tree, browser_of
from tests.support.view_frames import parse_frame


async def first_revision(browser: Browser) -> int:
    """Return the revision that the next update starts from."""
    return int(parse_frame((await browser.next_update()).frame)[0]["from"])


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
