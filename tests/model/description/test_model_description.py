"""Theorems about whole descriptions: summaries are what MuJoCo computes, values plain, addresses tile its vectors."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import mujoco
import pytest

from mjrun.model.description.model_description import SECTIONS, ModelDescription


def test_the_summary_is_what_mujoco_says(scene: ModelDescription) -> None:
    model, found = scene.model, scene.summary
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert found.mass == mujoco.mj_getTotalmass(model)
    weights = model.body_mass / model.body_mass.sum()
    assert found.centre_of_mass == pytest.approx(weights @ data.xipos, abs=1e-12)
    assert (found.memory.model, found.memory.data, found.memory.arena) == (model.nbuffer, data.nbuffer, model.narena)
    assert found.sizes == {name: getattr(model, name) for name in found.sizes}
    assert (found.extent, found.timestep) == (model.stat.extent, model.opt.timestep)
    assert found.name == ET.parse(scene.path or "").getroot().get("model", "MuJoCo Model")
    assert found.jacobian == ("sparse" if mujoco.mj_isSparse(model) else "dense")


def test_nothing_has_no_centre_of_mass_and_no_settings(described: Callable[[str], ModelDescription]) -> None:
    empty = described("<mujoco/>")
    assert (empty.summary.mass, empty.summary.centre_of_mass, empty.summary.file) == (0, None, None)
    assert [name for name in SECTIONS if getattr(empty, name)] == ["summary", "bodies", "statistics"]
    assert [(body.name, body.parent, body.depth) for body in empty.bodies] == [("world", -1, 0)]


def leaves(value: Any) -> Iterator[Any]:
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, dict | tuple):
        for item in value.values() if isinstance(value, dict) else value:
            yield from leaves(item)
    else:
        yield value


def test_every_value_is_plain(scene: ModelDescription, mixed: ModelDescription) -> None:
    for description in (scene, mixed):
        for name in SECTIONS:
            assert {type(leaf) for leaf in leaves(getattr(description, name))} <= {str, int, float, bool, type(None)}


def tiles(blocks: list[tuple[int | None, int]], total: int) -> bool:
    """Whether blocks of (start, size) lie one after the other, from 0 to `total`."""
    taken = [i for start, size in blocks if start is not None for i in range(start, start + size)]
    return taken == [*range(total)]


def test_addresses_tile_every_vector(scene: ModelDescription, mixed: ModelDescription) -> None:
    for found in (scene, mixed):
        model = found.model
        assert tiles([(joint.qpos, joint.qpos_size) for joint in found.joints], model.nq)
        assert tiles([(joint.dof, joint.dof_size) for joint in found.joints], model.nv)
        assert tiles([(actuator.ctrl, actuator.ctrl_size) for actuator in found.actuators], model.nu)
        assert tiles([(actuator.act, actuator.act_size) for actuator in found.actuators], model.na)
        assert tiles([(sensor.address, sensor.dim) for sensor in found.sensors], model.nsensordata)
