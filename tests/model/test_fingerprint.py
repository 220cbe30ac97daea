"""Theorems about what tells models apart that move or are measured differently."""

from collections.abc import Callable

import mujoco
import pytest

from mjrun.model.source import physics_fingerprint
from tests.cases import mjcf

XML = mjcf("textured_box")


def changed(change: Callable[[mujoco.MjSpec], object]) -> str:
    spec = mujoco.MjSpec.from_string(XML)
    change(spec)
    return physics_fingerprint(spec.compile())


SAME: list[Callable[[mujoco.MjSpec], object]] = [
    lambda spec: None,
    lambda spec: setattr(spec.visual.map, "force", 3),
    lambda spec: setattr(spec.geom("box"), "rgba", [1, 0, 0, 1]),
    lambda spec: setattr(spec.geom("box"), "group", 3),
    lambda spec: setattr(spec.light("sun"), "pos", [1, 0, 3]),
    lambda spec: setattr(spec.camera("side"), "fovy", 20),
    lambda spec: setattr(spec.texture("t"), "rgb1", [1, 1, 0]),
    lambda spec: setattr(spec.key("up"), "qpos", [2]),
    lambda spec: spec.add_key(name="down"),
    lambda spec: spec.worldbody.add_camera(name="top", pos=[0, 0, 3]),
    lambda spec: spec.worldbody.add_light(name="lamp"),
    lambda spec: spec.add_material(name="steel"),
    lambda spec: setattr(spec.joint("hinge"), "name", "knee") or setattr(spec.actuator("motor"), "target", "knee"),
]
OTHER: list[Callable[[mujoco.MjSpec], object]] = [
    lambda spec: setattr(spec.option, "gravity", [0, 0, -1]),
    lambda spec: setattr(spec.option, "timestep", 0.001),
    lambda spec: setattr(spec.option, "integrator", mujoco.mjtIntegrator.mjINT_RK4),
    lambda spec: setattr(spec.geom("box"), "density", 10),
    lambda spec: setattr(spec.geom("box"), "friction", [2, 0.1, 0.1]),
    lambda spec: setattr(spec.geom("box"), "size", [0.2, 0, 0]),
    lambda spec: setattr(spec.joint("hinge"), "axis", [0, 1, 0]),
    lambda spec: setattr(spec.actuator("motor"), "gear", [2, 0, 0, 0, 0, 0]),
    lambda spec: setattr(spec.body("box"), "pos", [1, 0, 0]),
]


@pytest.mark.parametrize("change", SAME)
def test_looks_starts_and_names_are_no_physics(change: Callable[[mujoco.MjSpec], object]) -> None:
    assert changed(change) == physics_fingerprint(mujoco.MjModel.from_xml_string(XML))


@pytest.mark.parametrize("change", OTHER)
def test_what_moves_or_weighs_otherwise_is_another(change: Callable[[mujoco.MjSpec], object]) -> None:
    assert changed(change) != physics_fingerprint(mujoco.MjModel.from_xml_string(XML))
