"""Text on a canvas fits, and is what its font has."""

import matplotlib
import pytest

from mjrun.plotting.canvas import Canvas, rgb, settings
from mjrun.plotting.theme import THEMES

CANVAS = Canvas((400, 200), THEMES["light"], False)


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
    assert Canvas((100, 100), THEMES["light"], True).shown("位\n") == "位\\n"


def test_a_box_is_from_the_bottom_left_in_shares() -> None:
    assert CANVAS.box(100, 50, 300, 150) == (0.25, 0.25, 0.5, 0.5)
    assert rgb((255, 0, 51)) == (1, 0, 0.2)


def test_settings_are_ours_and_the_user_s_come_back() -> None:
    with matplotlib.rc_context({"font.size": 31}):
        with settings():
            assert matplotlib.rcParams["font.size"] == 10
            assert matplotlib.rcParams["text.parse_math"] is False
        assert matplotlib.rcParams["font.size"] == 31
