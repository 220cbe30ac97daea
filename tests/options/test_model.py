"""What is overridden in a model, as MuJoCo names it."""

import math
import re
from pathlib import Path

import mujoco
import pytest

from mjrun.model.names import enum_members
from mjrun.model.override import overrides_of
from mjrun.model.sources import parse_source
from mjrun.options.model import INTEGRATORS, ModelOptions
from mjrun.options.option import options_of

MODEL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="box"><freejoint/><geom name="ball" size=".1"/></body>
  </worldbody>
</mujoco>
"""


def test_integrators_are_those_of_mujoco() -> None:
    assert set(INTEGRATORS) == set(enum_members(mujoco.mjtIntegrator))


def test_every_example_in_help_changes_a_model(tmp_path: Path) -> None:
    path = tmp_path / "floor.xml"
    path.write_text(MODEL)
    (declared,) = (each for each in options_of(ModelOptions) if each.name == "set")
    examples = dict(re.findall(r"([\w./:*[\]]+)=(\S+?)(?=, |; |\.(?: |$))", declared.help))
    assert len(examples) == 8
    model = parse_source(str(path), overrides_of(ModelOptions(set=examples))).load()
    assert model.opt.gravity.tolist() == [0, 0, 10]
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    assert model.geom("floor").friction.tolist() == [0.1, 0.005, 0.0001]
    assert model.vis.quality.shadowsize == 1024
    assert model.body("box").pos.tolist() == [0, 0, 0.1]
    assert model.geom("ball").size[0] == 0.025
    assert model.body("box").mass[0] == pytest.approx(1200 * 4 / 3 * math.pi * 0.025**3)
