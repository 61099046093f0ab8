"""Drake's families on the page, in a real browser: hidden at first, shown and faded by their controls."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.adapters.drakeviewer.encoding import SPHERE, contacts, draw, geometry, link, load, point_contact
from tests.adapters.viewer.browser.page import FLAGS, View, hub_url, row
from tests.support.browser import chromium
from tests.support.gateway_process import gateway_process
from tests.support.liblcm import liblcm

pytestmark = [pytest.mark.browser, pytest.mark.slow]
RED, GREEN = (1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def shown() -> Iterator[tuple[View, Any]]:
    lcm = liblcm()
    with chromium() as browser, gateway_process(*FLAGS) as (_, url), View(browser, url) as view:
        yield view, lcm.LCM(hub_url(url))


def publish(bus: Any, family: str, x: float, color: tuple[float, ...]) -> None:
    bus.publish(f"DRAKE_VIEWER_LOAD_ROBOT{family}", load(link("plant::ball", 1, geometry(SPHERE, [0.6], color))))
    bus.publish(f"DRAKE_VIEWER_DRAW{family}", draw({(1, "plant::ball"): (x, 0, 0, 1, 0, 0, 0)}))


def test_families_have_visibility_and_opacity(shown: tuple[View, Any]) -> None:
    view, bus = shown
    publish(bus, "", -1.0, RED)
    publish(bus, "_PROXIMITY", 1.0, GREEN)
    view.look_at("drake", "proximity", "plant", "ball")
    view.until(lambda: view.share("red", "left") > 0.02, "the illustration")
    assert view.share("green") == 0.0, "proximity is hidden at first"
    families = view.page.locator(".families")
    assert families.locator(".family").count() == 2
    families.get_by_label("Show all proximity").click()
    view.until(lambda: view.share("green", "right") > 0.01, "proximity")
    families.get_by_label("Opacity of proximity").fill("0.05")
    view.until(lambda: view.share("green") == 0.0, "proximity is nearly transparent")
    families.get_by_label("Hide all illustration").click()
    view.until(lambda: view.share("red") == 0.0, "the illustration is hidden")
    assert row(view, ["drake", "illustration"]).get_attribute("class") == "row hidden"
    families.get_by_label("Show all illustration").click()
    view.until(lambda: view.share("red") > 0.02, "the illustration is back")


def test_a_robot_moves_and_contacts_come_and_go(shown: tuple[View, Any]) -> None:
    view, bus = shown
    publish(bus, "", -1.0, RED)
    view.look_at("drake", "illustration", "plant", "ball")
    view.until(lambda: view.share("red", "left") > 0.02, "the ball on the left")
    bus.publish("DRAKE_VIEWER_DRAW", draw({(1, "plant::ball"): (1.0, 0, 0, 1, 0, 0, 0)}))
    view.until(lambda: view.share("red", "right") > 0.02, "the ball on the right")
    bus.publish("CONTACT_RESULTS", contacts([point_contact("a", "b", (-1, 0, 0), (0, 0, 10))]))
    arrow = "scenegate.model.find(['drake', 'contacts', 'point', 'a+b'])"
    view.until(lambda: view.page.evaluate(f"{arrow} != null"), "an arrow")
    drawn = "scenegate.drawing.bounds(scenegate.model.find(['drake', 'contacts'])).max.z"
    view.until(lambda: abs(view.page.evaluate(drawn) - 0.504) < 1e-3, "its tip")
    bus.publish("CONTACT_RESULTS", contacts())
    view.until(lambda: view.page.evaluate(f"{arrow} == null"), "no arrow")
