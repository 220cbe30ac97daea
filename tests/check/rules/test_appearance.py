"""Scenes without light, geoms with the same surface, and cameras that see nothing."""

from pathlib import Path

import mujoco
import pytest

from mjrun.check.rules.appearance import VISIBLE_GROUPS
from mjrun.errors import option
from mjrun.model.sources import load
from tests.check.models import lint, mjcf

BOX = '<geom name="{}" type="box" size="1 2 3" rgba="{} 0 0 1" {}/>'
DARK = '<visual><headlight ambient="0 0 0" diffuse="0 0 0"/></visual>'


def codes(world: str, before: str = "") -> list[str]:
    return [finding.code for finding in lint(mjcf(world, before=before)) if finding.code.startswith("MJ60")]


@pytest.mark.parametrize(
    ("light", "headlight", "found"),
    [
        ("", "", []),
        ("", DARK, ["MJ602"]),
        ("<light/>", DARK, []),
        ('<light active="false"/>', DARK, ["MJ602"]),
        ("", '<visual><headlight active="0"/></visual>', ["MJ602"]),
    ],
)
def test_a_light_or_the_headlight_shines(light: str, headlight: str, found: list[str]) -> None:
    assert codes(f'{light}<geom size="1"/>', headlight) == found


@pytest.mark.parametrize(
    ("other", "found"),
    [
        (BOX.format("b", 1, ""), ["MJ603"]),
        (BOX.format("b", 1, 'pos="1e-9 0 0"'), ["MJ603"]),
        (BOX.format("b", 1, 'pos="1e-3 0 0"'), []),
        (BOX.format("b", 1, f'group="{VISIBLE_GROUPS}"'), []),
        (BOX.format("b", 0, ""), []),
        (BOX.format("b", 1, "").replace("1 2 3", "1 2 3.1"), []),
        (f"<body>{BOX.format('b', 1, '')}</body>", []),
    ],
)
def test_geoms_flicker_where_their_surfaces_are_the_same_and_their_colours_are_not(
    other: str, found: list[str]
) -> None:
    assert codes(BOX.format("a", 0, "") + other) == found


def test_a_geom_that_its_material_hides_flickers_with_none() -> None:
    material = '<asset><material name="m" rgba="1 0 0 {}"/></asset>'
    other = '<geom name="b" type="box" size="1 2 3" material="m"/>'
    for alpha, found in ((1, ["MJ603"]), (0, [])):
        assert codes(BOX.format("a", 0, "") + other, material.format(alpha)) == found


def looking(camera: str, geom: str = 'pos="0 0 -3" size=".1"') -> str:
    return mjcf(f'<geom {geom}/>\n<camera name="eye" {camera}/>')


SEEN = [
    ('zaxis="0 0 1"', 'pos="0 0 -3" size=".001"'),  # smaller than a pixel
    ('zaxis="0 0 1"', 'pos="0 0 -3" type="plane" size="1 1 1"'),
    ('zaxis="0 0 1" projection="orthographic" fovy="1"', 'pos=".4 0 -3" size=".01"'),
    ('zaxis="0 0 1" fovy="10"', 'pos="0 .25 -3" size=".01"'),
    ('zaxis="0 0 1" focal=".01 .01" sensorsize=".01 .01" resolution="100 100"', 'pos="1.4 0 -3" size=".01"'),
]


UNSEEN = [
    ('zaxis="0 0 1"', 'pos="0 0 -3" size="1" group="3"'),
    ('zaxis="0 0 1"', 'pos="0 0 -3" size="1" rgba="1 1 1 0"'),
    ('zaxis="0 0 1"', 'pos="0 0 3" size="1"'),
    ('zaxis="0 0 1" fovy="10"', 'pos="0 .35 -3" size=".01"'),
    ('zaxis="0 0 1" projection="orthographic" fovy="1"', 'pos="2 0 -3" size=".01"'),
    ('zaxis="0 0 1" focal=".01 .01" sensorsize=".01 .01" resolution="100 100"', 'pos="1.6 0 -3" size=".01"'),
]


@pytest.mark.parametrize(("camera", "geom"), SEEN)
def test_a_camera_that_sees_anything_is_well(camera: str, geom: str) -> None:
    assert lint(looking(camera, geom)) == []


@pytest.mark.parametrize(
    ("world", "reported"),
    [
        ('<body><geom size=".1"/>{}</body>', False),
        ('<body><geom size=".1"/></body>{}', True),
        ('<geom type="plane" size="0 0 1"/><body pos="0 0 1"><geom size=".1"/>{}</body>', True),
    ],
    ids=["of a body", "of the world", "above a floor"],
)
def test_the_camera_of_a_body_may_look_at_the_scene_that_a_part_is_for(world: str, reported: bool) -> None:
    model = mjcf(world.format('<camera name="eye" zaxis="0 0 -1" pos="0 0 .2"/>'))
    assert [f.object for f in lint(model) if f.code == "MJ601"] == ["camera 'eye'"] * reported


@pytest.mark.parametrize(("camera", "geom"), UNSEEN)
def test_a_camera_that_sees_nothing_is_told(camera: str, geom: str) -> None:
    assert [f.code for f in lint(looking(camera, geom))] == ["MJ601"]


FOUR = '<visual><quality shadowsize="64" offsamples="0"/></visual>'
FOUR += '<asset><mesh name="m" vertex="-.2 -.2 -.2 .2 -.2 -.2 0 .3 -.2 0 0 .3"/></asset>'


AROUND = [
    'type="box" size=".15 .15 .15"',
    'type="sphere" size=".15"',
    'type="capsule" size=".15 .1"',
    'type="cylinder" size=".15 .15"',
    'type="ellipsoid" size=".15 .2 .15"',
    'type="box" size=".15 .15 .15" rgba="1 1 1 .5"',
    'type="mesh" mesh="m"',
    'type="mesh" mesh="m" pos="0 0 -.5"',
    'type="box" size=".15 .15 .15" pos="0 0 -.2"',
    'type="sphere" size=".15" pos="0 0 -.3"',
    'type="plane" size="1 1 .1" pos="0 0 -.1"',
    'type="plane" size="1 1 .1" pos="0 0 -.1" zaxis="0 0 -1"',
]


@pytest.mark.parametrize(
    ("geom", "other"), [*((geom, "") for geom in AROUND), (AROUND[0], '<geom name="other" pos="0 0 -3" size=".5"/>')]
)
def test_a_camera_in_a_geom_sees_what_mujoco_draws_of_it_and_through_it(geom: str, other: str) -> None:
    text = mjcf(f'<geom name="skull" {geom}/>\n<camera name="eye"/>\n{other}', before=FOUR)
    findings = lint(text)
    model = load(Path("model.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 24, 32) as renderer:
        renderer.enable_segmentation_rendering()
        renderer.update_scene(data, "eye")
        drawn = bool((renderer.render()[..., 0] >= 0).any())
    assert ["MJ601" for _ in range(not drawn)] == [f.code for f in findings if f.code == "MJ601"]
    assert all("it is inside geom 'skull'" in f.message for f in findings)


@pytest.mark.parametrize("principal", ["0 .004", "0 -.004", ".004 0", "-.004 0"])
@pytest.mark.parametrize("place", ["0 .5", "0 -.5", ".5 0", "-.5 0"])
def test_a_camera_whose_image_is_shifted_sees_what_mujoco_draws(principal: str, place: str) -> None:
    intrinsics = f'resolution="100 100" sensorsize=".01 .01" focal=".01 .01" principal="{principal}"'
    findings = lint(looking(f'zaxis="0 0 1" {intrinsics}', f'pos="{place} -1" size=".1"'))
    model = load(Path("model.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 32, 32) as renderer:
        renderer.enable_segmentation_rendering()
        renderer.update_scene(data, "eye")
        drawn = bool((renderer.render()[..., 0] >= 0).any())
    assert [f.code for f in findings] == ["MJ601" for _ in range(not drawn)]


@pytest.mark.parametrize(
    ("hidden", "message", "remedy"),
    [
        ('group="3"', "is in group 3", f"{option('geomgroup')} 0,1,2,3"),
        ('group="5"', "is in group 5", f"{option('geomgroup')} 0,1,2,5"),
        ('rgba="1 1 1 0"', "is transparent, with alpha 0", "give it or its material an alpha"),
    ],
)
def test_what_is_hidden_before_a_camera_is_named(hidden: str, message: str, remedy: str) -> None:
    glass = "" if "rgba" in hidden else 'name="glass" pos="0 0 -3" size="1" rgba="1 1 1 0"/>\n<geom '
    (finding,) = lint(looking('zaxis="0 0 1"', f'{glass}name="veiled" pos="0 0 -3" size="1" {hidden}'))
    assert f"geom 'veiled' in its view {message}" in finding.message
    assert remedy in finding.remedy
