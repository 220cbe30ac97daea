"""The names of the numbers in a state, against what writing them one by one does to MjData."""

import mujoco
import numpy as np
import pytest

from mjrun.model import state
from mjrun.probe.state_columns import state_columns
from tests.model.test_state import CROWDED

EXPECTED = {
    "time": ("time", 0),
    "qpos/root/z": ("qpos", 2),
    "qpos/swivel/qw": ("qpos", 7),
    "qpos/knee": ("qpos", 11),
    "qvel/swivel/wz": ("qvel", 8),
    "act/filter": ("act", 0),
    "ctrl/late": ("ctrl", 1),
    "xfrc_applied/box/fz": ("xfrc_applied", 14),
    "xfrc_applied/box/tx": ("xfrc_applied", 15),
    "mocap_pos/0/z": ("mocap_pos", 2),
    "userdata/2": ("userdata", 2),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_a_name_stands_where_its_number_is(name: str) -> None:
    model = mujoco.MjModel.from_xml_string(CROWDED)
    names = state_columns(model)
    assert len(names) == len(set(names)) == state.size(model)

    data = mujoco.MjData(model)
    numbers = state.save(model, data)
    numbers[names.index(name)] = 7.25
    state.restore(model, data, numbers)
    field, index = EXPECTED[name]
    assert np.ravel(getattr(data, field))[index] == 7.25
