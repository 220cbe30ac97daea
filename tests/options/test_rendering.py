"""Choices of drawing are those that the layers below implement, and names in help are MuJoCo's."""

import re
from collections.abc import Callable

import mujoco
import pytest

from mjrun.camera.script import parse_camera
from mjrun.errors import BadValueError, UnknownNameError
from mjrun.formats import calibration_writer, image_format
from mjrun.options.option import options_of
from mjrun.options.rendering import (
    BACKENDS,
    CALIBRATION_FORMATS,
    CORNERS,
    LAYOUTS,
    QUALITIES,
    RENDERERS,
    RIG_EXAMPLES,
    STYLES,
    VIEWS,
    ViewOptions,
)
from mjrun.rendering import backend, text
from mjrun.rendering.compositor import RENDERERS as IMPLEMENTED_RENDERERS
from mjrun.rendering.compositor import columns
from mjrun.rendering.segmentation import groupings
from mjrun.rendering.visual import GROUPS, Visual, flags, frame_axes, labels

OPTIONS = {each.name: each for each in options_of(ViewOptions)}


def test_choices_are_those_that_are_implemented() -> None:
    assert set(VIEWS) == set(image_format.FORMATS)
    assert set(RENDERERS) == set(IMPLEMENTED_RENDERERS)
    assert set(CALIBRATION_FORMATS) == set(calibration_writer.FORMATS)
    assert set(CORNERS) == set(text.CORNERS)
    assert STYLES == ("color", "exact")
    assert set(re.findall(r"\w+", BACKENDS)) - {"or"} <= {backend.AUTO, *backend.BACKENDS}


def test_the_examples_in_the_help_of_cameras_are_cameras_of_their_rigs() -> None:
    box = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body name='box'/></worldbody></mujoco>")
    for kind, example in RIG_EXAMPLES.items():
        (shot,) = parse_camera(example, box).shots
        assert shot.rig.kind == kind
        assert f" {kind}" in OPTIONS["camera"].help
        assert f" {example}" in OPTIONS["camera"].help


def test_every_quality_and_layout_can_be_drawn_and_no_other() -> None:
    assert [Visual(quality=name).quality for name in QUALITIES] == [*QUALITIES]
    with pytest.raises(UnknownNameError):
        Visual(quality="best")
    assert [columns(4, (64, 48), name) for name in LAYOUTS] == [4, 1, 2]
    with pytest.raises(UnknownNameError):
        columns(4, (64, 48), "pile")


def test_there_is_an_option_for_the_groups_of_each_kind_of_object() -> None:
    assert {name for name in OPTIONS if name.endswith("group")} == {f"{kind}group" for kind in GROUPS}


@pytest.mark.parametrize(
    ("option", "names"),
    [("show", flags), ("hide", flags), ("frame_axes", frame_axes), ("label", labels), ("seg_by", groupings)],
)
def test_names_in_help_are_those_there_are(option: str, names: Callable[[], list[str]]) -> None:
    listed = re.findall(r"[a-z][a-z-]*", OPTIONS[option].help.partition(":")[2].replace(" or ", " "))
    assert listed
    assert set(listed) <= set(names())


def test_python_may_give_one_or_several_and_a_wrong_one_is_named() -> None:
    view = ViewOptions(camera=0, view=["rgb", "depth"], show="joint,contactpoint", size=(64, 48))
    assert (view.camera, view.view, view.show) == (("0",), ("rgb", "depth"), ("joint", "contactpoint"))
    with pytest.raises(BadValueError, match=r"^view: .*deep.* is not one of rgb, depth, seg"):
        ViewOptions(view=["rgb", "deep"])
    with pytest.raises(BadValueError, match=r"^depth_range: '2, 1' is not two depths in metres, the nearer first"):
        ViewOptions(depth_range=(2, 1))
