"""A ground: a plane that collides, added by an option."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.errors import UsageError
from mjrun.model.stage import GROUND


def test_a_ground_is_a_plane_in_a_last_body_and_the_motion_that_of_such_a_model(tmp_path: Path) -> None:
    ball = '<body name="ball" pos="0 0 .2"><freejoint/><geom size=".1"/></body>'
    plane = '<body pos="0 0 -.1"><geom type="plane" size="0 0 .05"/></body>'
    path = tmp_path / "ball.xml"
    path.write_text(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
    simulation = mjrun.Simulation(path, ground=-0.1)
    models = [
        simulation.load(),
        mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{ball}{plane}</worldbody></mujoco>"),
    ]
    ends = []
    for model in models:
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=500)
        ends.append(data.qpos.copy())
    assert np.array_equal(*ends)
    assert ends[0][2] == pytest.approx(0, abs=0.01)


def test_a_ground_needs_a_free_name(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text('<mujoco><worldbody><geom name="ground" size=".1"/></worldbody></mujoco>')
    with pytest.raises(UsageError, match=f"already has a body or a geom called {GROUND}"):
        mjrun.Simulation(path, ground=0).load()


@pytest.mark.parametrize(
    ("plane", "is_floor"),
    [('pos="0 0 .2"', True), ('pos="3 4 .2"', True), ('pos="0 0 .1"', False), ('pos="0 0 .2" euler="90 0 0"', False)],
)
def test_a_second_floor_whose_contacts_would_count_twice_is_refused(tmp_path: Path, plane: str, is_floor: bool) -> None:
    path = tmp_path / "m.xml"
    path.write_text(f'<mujoco><worldbody><geom name="base" type="plane" size="1 1 1" {plane}/></worldbody></mujoco>')
    simulation = mjrun.Simulation(path, ground=0.2)
    if is_floor:
        with pytest.raises(UsageError, match="the model has a floor at this height already, base"):
            simulation.load()
    else:
        assert simulation.load().ngeom == 2
