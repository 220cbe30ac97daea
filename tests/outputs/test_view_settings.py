"""What options of views ask of MuJoCo's visualizer, and what they may not ask."""

import mujoco
import pytest

from mjrun.errors import MjrunError, UnknownNameError
from mjrun.options.view import RENDERERS as NAMES
from mjrun.options.view import ViewOptions
from mjrun.outputs.view_settings import RENDERERS, check_segmentation_name, check_view, visual_of
from mjrun.rendering.segmentation import groupings

KINDS = ["geom", "site", "joint", "tendon", "actuator", "flex", "skin"]


@pytest.mark.parametrize("kind", KINDS)
def test_groups_are_those_of_their_own_kind(kind: str) -> None:
    options = visual_of(ViewOptions(**{f"{kind}group": (1, 4)})).options()  # type: ignore[arg-type]
    untouched = mujoco.MjvOption()
    for other in KINDS:
        groups, default = (getattr(value, f"{other}group").tolist() for value in (options, untouched))
        assert groups == ([0, 1, 0, 0, 1, 0] if other == kind else default)


def test_flags_frames_and_labels_reach_the_visualizer() -> None:
    options = visual_of(ViewOptions(show="joint", hide="texture", frame_axes="body", label="geom")).options()
    assert options.flags[mujoco.mjtVisFlag.mjVIS_JOINT] == 1
    assert options.flags[mujoco.mjtVisFlag.mjVIS_TEXTURE] == 0
    assert (options.frame, options.label) == (mujoco.mjtFrame.mjFRAME_BODY, mujoco.mjtLabel.mjLABEL_GEOM)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"show": "nonsense"}, "no visual flag 'nonsense'"),
        ({"show": "joint", "hide": "joint"}, "joint"),
        ({"seg_by": "colour"}, "no segmentation 'colour'"),
        ({"depth_range": (-1, 2)}, "depth_range: .*two depths in metres"),
        ({"camera": ["a", "b", "a"]}, "camera: each once, and at least one"),
        ({"view": ()}, "view: each once, and at least one"),
        ({"label": "nobody"}, "nobody"),
    ],
)
def test_a_view_that_cannot_be_is_refused_without_a_model(values: dict[str, object], message: str) -> None:
    with pytest.raises(MjrunError, match=message):
        check_view(ViewOptions(**values))  # type: ignore[arg-type]


def test_every_name_of_a_segmentation_and_of_a_renderer_is_known() -> None:
    assert tuple(RENDERERS) == NAMES
    for name in groupings():
        check_segmentation_name(name)
        check_view(ViewOptions(seg_by=name))
    with pytest.raises(UnknownNameError, match="did you mean 'body'"):
        check_segmentation_name("bdy")
