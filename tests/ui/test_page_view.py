"""The page in Chromium: furniture in the way of the camera, the view of the wrist camera, light and dark."""

import numpy as np
import pytest
from page import AT_REST, SHOWN, until, visiting

pytestmark = [pytest.mark.browser, pytest.mark.timeout(600)]
TABLE, FLOOR = (4.9, 1.9, 0.78), (2.0, 0.4, 0.0)  # [m] on the table, where no cube is; free floor
PATCH = 8  # [px]
HOLES, GREY = 0.15, 12.0  # share of neighbouring pixels that differ by so many levels


def test_the_plan_view_looks_through_furniture_and_the_wrist_camera_is_shown_by_a_key(browser, begun):
    with visiting(browser, begun("exp1", play=False)) as visitor:
        assert not pierced(visitor, TABLE)
        visitor.page.keyboard.press("2")
        until(lambda: pierced(visitor, TABLE), SHOWN, "the table hides what is below it")
        assert not pierced(visitor, FLOOR)

        wrist = visitor.page.locator("canvas.wrist")
        assert not wrist.is_visible()
        visitor.page.keyboard.press("i")
        read = "() => [...document.querySelector('.wrist').getContext('2d').getImageData(0, 0, 256, 192).data]"
        until(lambda: np.std(visitor.page.evaluate(read)[::4]) > 10.0, SHOWN, "the wrist camera shows nothing")
        visitor.press("Wrist camera")
        wrist.wait_for(state="hidden", timeout=SHOWN * 1000)


def test_the_page_is_as_dark_as_the_browser_prefers_until_somebody_chooses(browser, begun):
    with visiting(browser, begun("exp1", play=False)) as visitor:
        page = visitor.page

        def shades(name):
            """Red of the ground of timeline, panel and headline, and whether the panel knows of it."""
            read = "(mark) => getComputedStyle(document.querySelector(mark)).backgroundColor.match(/[0-9]+/)[0]"
            grounds = [int(page.evaluate(read, mark)) for mark in ("#motm .bar", "div:has(> .motm-top)")]
            return page.locator(f"html[data-mantine-color-scheme={name}]").count() == 1, grounds

        assert shades("light") == (True, [255, 255])
        page.emulate_media(color_scheme="dark")
        until(lambda: shades("dark")[0] and max(shades("dark")[1]) < 64, SHOWN, "not dark")
        visitor.press("Light or dark")
        until(lambda: shades("light") == (True, [255, 255]), SHOWN, "not light again")
        page.reload()
        page.locator(".cover").wait_for(state="detached", timeout=SHOWN * 1000)
        until(lambda: shades("light") == (True, [255, 255]), SHOWN, "the choice is forgotten")
        page.emulate_media(color_scheme="light")


def test_the_view_never_goes_below_the_floor_however_far_down_it_is_dragged(browser, begun):
    with visiting(browser, begun("exp1", play=False)) as visitor:
        mouse = visitor.page.mouse
        for key in ("1", "3"):
            visitor.page.keyboard.press(key)
            visitor.page.wait_for_timeout(AT_REST)
            visitor.rest()
            for _ in range(3):
                mouse.move(60, 440)
                mouse.down()
                for y in range(440, 20, -60):
                    mouse.move(60, y)
                    visitor.page.wait_for_timeout(50)
                mouse.up()
                place = visitor.eye()[0]
                assert place[2] > 0.1, f"key {key}: the eye is at {place}"
            place, ahead = visitor.rest()
            assert place[2] > 0.1, f"key {key}: the eye comes to rest at {place}"
            assert abs(ahead[2]) < 0.9, f"key {key}: it looks along {ahead}"


def pierced(visitor, place):
    """True when the picture has holes round a point of the world [m]."""
    picture = visitor.picture()
    canvas = visitor.page.locator("canvas[data-engine]").bounding_box()
    x, y = visitor.page.evaluate("(place) => motm.pixel(place)", list(place))
    row, column = int(y - canvas["y"]), int(x - canvas["x"])
    patch = picture[row - PATCH : row + PATCH, column - PATCH : column + PATCH].mean(axis=2)
    return patch.size > 0 and bool((np.abs(np.diff(patch, axis=1)) > GREY).mean() > HOLES)
