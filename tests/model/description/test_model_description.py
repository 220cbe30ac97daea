"""Theorems about whole descriptions: every value is plain, and addresses tile MuJoCo's vectors."""

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import mujoco

from mjrun.model.description.model_description import SECTIONS, ModelDescription
from mjrun.model.mujoco_globals import collected_warnings


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


def test_every_real_model_is_described_whole(shared_models: Path) -> None:
    described_ones = 0
    for path in sorted(shared_models.rglob("*.xml")):
        with collected_warnings():
            try:
                model = mujoco.MjModel.from_xml_path(str(path))
            except ValueError:
                assert "malformed" in path.parts
                continue
            found = ModelDescription(model, path)
            assert all(getattr(found, name) is not None for name in SECTIONS)
        assert found.summary.mass == mujoco.mj_getTotalmass(model)
        assert all(asset.bytes for asset in found.assets if asset.path)
        described_ones += 1
    assert described_ones > 20
