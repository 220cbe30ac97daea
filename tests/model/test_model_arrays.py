"""Models of which each simulation has different numbers."""

import mujoco
import numpy as np

from mjrun.model.fields import VariedModel, read_array, restore_array, write_array

MODEL = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="1"/><geom size="2"/></worldbody></mujoco>')


def test_an_array_is_written_as_it_is_read_and_restored() -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="3"/><geom size="4"/></worldbody></mujoco>')
    for name, shape in (
        ("geom_friction", (2, 3)),
        ("opt.gravity", (1, 3)),
        ("opt.timestep", (1, 1)),
        ("stat.extent", (1, 1)),
    ):
        values = np.random.default_rng(1).uniform(1, 2, shape)
        write_array(model, name, values)
        np.testing.assert_array_equal(read_array(model, name), values)
        restore_array(model, name, MODEL)
        np.testing.assert_array_equal(read_array(model, name), read_array(MODEL, name))


def test_each_simulation_has_a_model_of_its_own_numbers() -> None:
    frictions = np.arange(12.0).reshape(2, 2, 3)
    varied = VariedModel(MODEL, {"geom_friction": frictions, "opt.timestep": np.array([[[0.1]], [[0.2]]])})
    before = MODEL.geom_friction.copy()
    for simulation, timestep in enumerate((0.1, 0.2)):
        model = varied.at(simulation)
        np.testing.assert_array_equal(model.geom_friction, frictions[simulation])
        assert model.opt.timestep == timestep
        np.testing.assert_array_equal(model.geom_size, MODEL.geom_size)
    np.testing.assert_array_equal(MODEL.geom_friction, before)
