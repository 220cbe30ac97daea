"""Theorems about summaries of models: they are what MuJoCo computes."""

import xml.etree.ElementTree as ET

import mujoco
import pytest

from mjrun.model.description.model_description import ModelDescription


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
