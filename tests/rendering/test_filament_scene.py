"""Filament's scene: light against the inverse square law, and what is drawn where, in a process of its own."""

import math
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.filament_worker import HEADLIGHT, LIGHTS, fallback_lighting
from tests.processes import PATIENCE

ROOT = Path(__file__).parents[2]

# --- lights -----------------------------------------------------------------------------------------


def lit(lights: str, custom: str = "") -> mujoco.MjModel:
    """A floor 1 m below the centre of the model, with lights."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><custom>{custom}</custom><statistic center="0 0 1" extent="2"/><worldbody>{lights}
        <geom type="plane" size="0 0 1"/></worldbody></mujoco>"""
    )


def illuminance(candela: float, distance: float) -> float:
    """Of a surface that faces a light [lux]."""
    return candela / distance**2


@pytest.mark.parametrize("height", [2.0, 50.0])
def test_a_light_brings_its_share_of_the_light_to_what_its_axis_hits(height: float) -> None:
    dim = '<light pos="0 0 3" diffuse=".5 .2 .1"/>'
    lights, headlight = fallback_lighting(lit(f'<light pos="0 0 {height}" diffuse="1 1 1" dir="0 0 -1"/>{dim}'))
    assert headlight == HEADLIGHT
    reached = min(height, 2 * (height - 1 + 2))  # the floor, if it is not too far beyond the centre
    assert illuminance(lights[0].candela, reached) == pytest.approx(LIGHTS / 2)
    assert illuminance(lights[1].candela, 3.0) == pytest.approx(LIGHTS / 2 * 0.5)
    assert lights[0].range == 5 * reached


def test_a_light_that_shines_along_the_floor_reaches_no_farther_than_the_model_is_large() -> None:
    grazing = math.radians(0.1)
    direction = f"{math.cos(grazing)} 0 {-math.sin(grazing)}"
    lights, _ = fallback_lighting(lit(f'<light pos="0 0 1" diffuse="1 1 1" dir="{direction}"/>'))
    assert lights[0].candela == pytest.approx(LIGHTS * (2 * (0 + 2)) ** 2)


def test_a_light_that_hits_nothing_shines_on_the_centre() -> None:
    lights, _ = fallback_lighting(lit('<light pos="0 0 4" diffuse="1 1 1" dir="0 0 1"/>'))
    assert illuminance(lights[0].candela, 3.0) == pytest.approx(LIGHTS)


def test_a_directional_light_has_its_own_brightness() -> None:
    lights, _ = fallback_lighting(lit('<light type="directional"/><light pos="0 0 3"/>'))
    assert set(lights) == {1}


def test_what_a_model_says_of_its_lights_is_left_alone() -> None:
    lamp = '<light pos="0 0 3"/>'
    assert fallback_lighting(lit(lamp + '<light pos="0 0 3" intensity="7"/>')) == ({}, 0.0)
    own = '<numeric name="filament.fallback.scene_light_intensity" data="1000"/>'
    assert fallback_lighting(lit(lamp, own)) == ({}, HEADLIGHT)
    head = '<numeric name="filament.fallback.head_light_intensity" data="123"/>'
    lights, headlight = fallback_lighting(lit(lamp, head))
    assert (set(lights), headlight) == ({0}, 123.0)


# --- drawing ----------------------------------------------------------------------------------------

# Seen from above, two metres high: a box to the left, another one to the right.
DRAWING = """
import sys
import mujoco
import numpy as np
from mjrun.camera.script import parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.errors import UsageError
from mjrun.model.state import save
from mjrun.rendering.filament_worker import FilamentScene, PixelFormat

model = mujoco.MjModel.from_xml_string('''<mujoco>
  <visual><headlight ambient=".5 .5 .5"/></visual>
  <worldbody>
    <camera name="above" pos="0 0 2" fovy="60"/>
    <geom name="left" type="box" size=".2 .2 .2" pos="-.6 0 0"/>
    <body name="right" pos=".6 0 0"><joint type="slide" axis="0 1 0"/><geom type="box" size=".2 .2 .2"/></body>
  </worldbody></mujoco>''')
SIZE = (48, 32)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
pose = BoundCameraScript(parse_camera("above", model), model, SIZE).pose(save(model, data))
colors, segments = PixelFormat("RGB8", "DEFAULT", 3, np.uint8), PixelFormat("RGB8", "SEGMENTATION_BY_ID", 3, np.uint8)
scene = FilamentScene(model, mujoco.MjvOption())
scene.update(data)
images = {}


def draw(name, size=SIZE):
    images[name] = scene.draw(size, pose, segments).copy()
    images[name + " colors"] = scene.draw(size, pose, colors).copy()


draw("whole")
draw("twice", (96, 64))
data.qpos[0] = .5
mujoco.mj_forward(model, data)
scene.update(data)
draw("moved")
abstract = mujoco.MjvScene(model, 10)
ball = abstract.geoms[0]
mujoco.mjv_initGeom(ball, mujoco.mjtGeom.mjGEOM_SPHERE, [.1, 0, 0], [0, 0, 0], np.eye(3).ravel(), [1, 0, 0, 1])
scene.decorate([ball])
draw("ball")
scene.decorate([])
draw("no ball")
mujoco.mjv_initGeom(ball, mujoco.mjtGeom.mjGEOM_HFIELD, [.1, 0, 0], [0, 0, 0], np.eye(3).ravel(), [1, 0, 0, 1])
try:
    scene.decorate([ball])
except UsageError as error:
    images["refusal"] = np.array(str(error))
scene.hide_all_but({(int(mujoco.mjtObj.mjOBJ_GEOM), 0)})
draw("hidden")
np.savez(sys.argv[1], **images)
"""


@pytest.fixture(scope="module")
def images(vulkan: WorkingBackend, tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """What Filament draws, by name, as the ids of segments and as colours."""
    path = tmp_path_factory.mktemp("filament") / "images.npz"
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{DRAWING}"
    subprocess.run([sys.executable, "-c", code, str(path)], check=True, capture_output=True, timeout=PATIENCE)
    with np.load(path) as arrays:
        return dict(arrays)


def centre(seen: np.ndarray) -> tuple[float, float]:
    """The centre of what is seen, in pixels from the middle of the image: to the right and up."""
    rows, columns = np.nonzero(seen)
    return float(columns.mean() + 0.5 - seen.shape[1] / 2), float(seen.shape[0] / 2 - rows.mean() - 0.5)


def pixels_per_metre(depth: float, height: int = 32) -> float:
    """At some distance from a camera with a vertical field of view of 60 degrees."""
    return height / 2 / (depth * math.tan(math.radians(30)))


@pytest.mark.parametrize(("name", "size"), [("whole", (32, 48)), ("twice", (64, 96))])
def test_geoms_are_where_the_camera_projects_them(
    images: dict[str, np.ndarray], name: str, size: tuple[int, int]
) -> None:
    numbers = images[name][:, :, 0]  # a geom's id plus one
    assert numbers.shape == size
    assert set(np.unique(numbers)) == {0, 1, 2}
    top = pixels_per_metre(1.8, size[0])  # what is nearest is the upper face
    for number, side in ((1, -1), (2, 1)):
        across, up = centre(numbers == number)
        assert abs(across - side * 0.6 * top) < 0.1 * top
        assert abs(up) < 0.05 * top


def test_the_model_is_drawn_where_it_was_moved_to(images: dict[str, np.ndarray]) -> None:
    moved, whole = images["moved"][:, :, 0], images["whole"][:, :, 0]
    assert centre(moved == 2)[1] == pytest.approx(0.5 * pixels_per_metre(1.8), abs=1.5)
    assert np.array_equal(moved == 1, whole == 1)


def test_what_is_added_is_seen_in_colour_alone_until_it_is_taken_away(images: dict[str, np.ndarray]) -> None:
    ball = images["ball colors"].astype(int)
    red = ball[:, :, 0] - ball[:, :, 1:].max(axis=2) > 40
    assert red.sum() == pytest.approx(math.pi * (0.1 * pixels_per_metre(2)) ** 2, rel=0.5)
    assert centre(red) == pytest.approx((0, 0), abs=1)
    assert np.array_equal(images["ball"], images["moved"])
    noise = np.abs(images["no ball colors"].astype(int) - images["moved colors"])
    assert noise.mean() < 1


def test_what_only_the_model_may_have_is_refused(images: dict[str, np.ndarray]) -> None:
    assert str(images["refusal"]).startswith("filament cannot render a hfield that is not part of the model\n")


def test_hidden_geoms_are_not_drawn(images: dict[str, np.ndarray]) -> None:
    hidden, moved = images["hidden"][:, :, 0], images["moved"][:, :, 0]
    assert np.array_equal(hidden == 1, moved == 1)
    assert set(np.unique(hidden)) == {0, 1}
