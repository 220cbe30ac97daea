"""Visual flags, groups, frames and labels by MuJoCo's own names."""

import warnings
from functools import cache

import mujoco
import numpy as np
import pytest

from mjrun.camera.script import parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.errors import BadValueError, UnknownNameError
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.state import save
from mjrun.rendering.visual import GROUPS, Visual, flags, updated_scene

VISUALIZER = [name for name in mujoco.mjtVisFlag.__members__ if name.startswith("mjVIS_")]
RENDERING = [name for name in mujoco.mjtRndFlag.__members__ if name.startswith("mjRND_")]


def scene() -> mujoco.MjvScene:
    return mujoco.MjvScene(mujoco.MjModel.from_xml_string("<mujoco/>"), 10)


def test_every_flag_of_mujoco_has_exactly_one_name() -> None:
    assert len(flags()) == len(set(flags())) == len(VISUALIZER) + len(RENDERING)


@pytest.mark.parametrize("name", VISUALIZER)
def test_a_visualizer_flag_is_switched_and_no_other(name: str) -> None:
    index, default = int(mujoco.mjtVisFlag.__members__[name]), mujoco.MjvOption().flags
    for value, visual in (
        (1, Visual(show=[name.removeprefix("mjVIS_").lower()])),
        (0, Visual(hide=[name.removeprefix("mjVIS_").lower()])),
    ):
        expected = default.copy()
        expected[index] = value
        assert np.array_equal(visual.options().flags, expected)


@pytest.mark.parametrize("name", RENDERING)
def test_a_rendering_flag_is_switched_and_no_other(name: str) -> None:
    index, default = int(mujoco.mjtRndFlag.__members__[name]), scene().flags
    for value, visual in (
        (1, Visual(show=[name.removeprefix("mjRND_").lower()])),
        (0, Visual(hide=[name.removeprefix("mjRND_").lower()])),
    ):
        changed, expected = scene(), default.copy()
        visual.set_flags(changed)
        expected[index] = value
        assert np.array_equal(changed.flags, expected)


def test_a_draft_has_no_shadows_and_reflections_unless_asked() -> None:
    shadow, reflection = int(mujoco.mjtRndFlag.mjRND_SHADOW), int(mujoco.mjtRndFlag.mjRND_REFLECTION)
    draft, asked = scene(), scene()
    Visual(quality="draft").set_flags(draft)
    Visual(quality="draft", show=["shadow"]).set_flags(asked)
    assert not draft.flags[shadow]
    assert not draft.flags[reflection]
    assert asked.flags[shadow]


@pytest.mark.parametrize("kind", GROUPS)
def test_groups_are_exactly_those_asked_for(kind: str) -> None:
    options = Visual(groups={kind: (1, 3)}).options()
    assert list(getattr(options, GROUPS[kind])) == [0, 1, 0, 1, 0, 0]
    others = [other for other in GROUPS.values() if other != GROUPS[kind]]
    assert all(np.array_equal(getattr(options, o), getattr(mujoco.MjvOption(), o)) for o in others)


def test_frames_and_labels_have_mujoco_s_names() -> None:
    options = Visual(frame="geom", label="joint").options()
    assert options.frame == mujoco.mjtFrame.mjFRAME_GEOM
    assert options.label == mujoco.mjtLabel.mjLABEL_JOINT


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"show": ["contactpoints"]}, "no visual flag 'contactpoints' (did you mean 'contactpoint'"),
        ({"hide": ["Shadow"]}, "did you mean 'shadow'?"),
        ({"frame": "geoms"}, "no frame 'geoms' (did you mean 'geom'?)"),
        ({"label": "bodies"}, "no label 'bodies' (did you mean 'body'?)"),
        ({"quality": "best"}, "qualities: draft, model, high"),
        ({"groups": {"bone": (1,)}}, "kinds: geom, site"),
    ],
)
def test_a_wrong_name_lists_the_right_ones(wrong: dict, message: str) -> None:
    with pytest.raises(UnknownNameError) as caught:
        Visual(**wrong)
    assert message in str(caught.value)


@pytest.mark.parametrize("wrong", [{"show": ["skin"], "hide": ["skin"]}, {"groups": {"geom": (6,)}}])
def test_what_cannot_be_is_refused(wrong: dict) -> None:
    with pytest.raises(BadValueError):
        Visual(**wrong)


GEOMS = 10_500


@cache
def crowd() -> mujoco.MjModel:
    balls = "".join(f"<geom size='.1' pos='{k % 100} {k // 100} 0'/>" for k in range(GEOMS))
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{balls}</worldbody></mujoco>")


@pytest.mark.parametrize(("maxgeom", "room"), [(10_000, 0), (1, 0), (20_000, 15_000)])
def test_a_scene_grows_until_everything_is_in_it_and_nobody_is_reported_to_increase_it(maxgeom: int, room: int) -> None:
    model = crowd()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pose = BoundCameraScript(parse_camera("free", model), model, (64, 48)).pose(save(model, data))
    scene = mujoco.MjvScene(model, maxgeom)
    scene.flags[0] = 1 - scene.flags[0]
    with collected_warnings() as texts, warnings.catch_warnings():
        warnings.simplefilter("error")
        grown = updated_scene(model, data, mujoco.MjvOption(), pose, scene, room)
    assert texts == []
    assert grown.maxgeom > GEOMS + room
    assert np.array_equal(grown.flags, scene.flags)
    assert {geom.objid for geom in grown.geoms[: grown.ngeom]} == set(range(GEOMS))
