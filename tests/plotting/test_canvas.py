"""Text on a canvas fits, and is what its font has."""

import matplotlib
import pytest

from mjrun.plotting.canvas import Canvas, settings
from mjrun.plotting.panel_grid import PanelGrid
from mjrun.plotting.theme import THEMES

LIGHT, GRID = THEMES["light"], PanelGrid((400, 200), 1, 1, 12.0)
CANVAS = Canvas(GRID, LIGHT)


@pytest.mark.parametrize("text", ["short", "contact_force/normal/z", "ω" * 300, "一" * 40])
@pytest.mark.parametrize("room", [30, 100, 250])
def test_a_fitted_text_has_no_more_than_its_room(text: str, room: float) -> None:
    shown = CANVAS.fitted(text, room, 12)
    assert CANVAS.measure(shown, 12) <= room
    if "…" in shown:
        head, tail = shown.split("…")
        whole = CANVAS.shown(text)
        assert whole.startswith(head)
        assert whole.endswith(tail)
    else:
        assert shown in (CANVAS.shown(text), text[:1])


def test_bold_text_is_wider_and_larger_text_too() -> None:
    assert CANVAS.measure("text", 12) < CANVAS.measure("text", 12, bold=True)
    assert CANVAS.measure("text", 24) == pytest.approx(2 * CANVAS.measure("text", 12), rel=0.1)


def test_letters_without_a_shape_are_left_to_who_shows_them_if_asked() -> None:
    assert CANVAS.shown("位\n") == "\\u4f4d\\n"
    assert Canvas(GRID, LIGHT, any_letter=True).shown("位\n") == "位\\n"


def test_settings_are_ours_and_the_user_s_come_back() -> None:
    with matplotlib.rc_context({"font.size": 31}):
        with settings(LIGHT, 12.0):
            assert matplotlib.rcParams["font.size"] == 10
            assert matplotlib.rcParams["text.parse_math"] is False
        assert matplotlib.rcParams["font.size"] == 31
