"""Theorems about the summary and the statistics of `mjrun info`."""

import mujoco
import pytest

from mjrun.cli.info_sections import statistics, summary
from mjrun.model.info import ModelDescription

TEXT = """
<mujoco>
  <option timestep=".005" gravity="0 0 -1"/>
  <worldbody>
    <body pos="1 0 0"><joint/><geom size=".1" mass="3"/></body>
    <body pos="-1 0 0"><geom size=".1" mass="3"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(TEXT)


def test_the_summary_has_mujocos_own_numbers(model: mujoco.MjModel) -> None:
    lines = dict(summary(ModelDescription(model).summary))
    assert lines["mass"] == f"{mujoco.mj_getTotalmass(model):g} kg" == "6 kg"
    assert lines["centre of mass"] == "0 0 0 m"
    assert lines["timestep"] == "0.005 s, euler integrator"
    assert lines["gravity"] == "0 0 -1 m/s²"
    assert lines["compiled by"] == f"MuJoCo {mujoco.mj_versionString()}"


def test_sizes_that_are_zero_are_left_out_but_those_that_everybody_asks_for(model: mujoco.MjModel) -> None:
    lines = dict(summary(ModelDescription(model).summary))
    assert lines["state"] == "nq=1  nv=1  na=0  nu=0"
    assert lines["objects"].startswith("nbody=3")
    assert "ncam" not in lines["objects"]
    assert "=0" not in lines["objects"]


def test_statistics_are_those_of_the_model_with_units(model: mujoco.MjModel) -> None:
    lines = dict(statistics(ModelDescription(model).statistics))
    assert lines["extent"] == f"{model.stat.extent:.5g} m"
    assert lines["meaninertia"] == f"{model.stat.meaninertia:.5g} kg·m²"
    assert list(lines) == ["center", "extent", "meansize", "meanmass", "meaninertia"]
