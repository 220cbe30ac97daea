"""Recordings against bare loops, and replayed."""

import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.model.override import Override
from mjrun.model.sources.file import FileSource
from mjrun.outputs.perform import perform
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.simulation.simulation import Simulation


def test_a_replay_gives_the_same_numbers_as_the_simulation(swing: Path, tmp_path: Path) -> None:
    live = Simulation(swing, steps=120, qvel={"hinge": 3})
    perform([Trace(live, f"{tmp_path}/a.csv"), Recording(live, f"{tmp_path}/r.npz")])
    Trace(Simulation(swing, replay=f"{tmp_path}/r.npz"), f"{tmp_path}/b.csv").run()
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    with pytest.raises(UsageError, match="the recording ends at step 120"):
        Trace(Simulation(swing, replay=f"{tmp_path}/r.npz", steps=121), f"{tmp_path}/c.csv").run()
    for start in ({"qvel": {"hinge": 1}}, {"key": "0"}, {"ctrl": {"motor": 1}}):
        with pytest.raises(UsageError, match=r"^replay and .* exclude each other: a recording holds all of the state"):
            Trace(Simulation(swing, replay=f"{tmp_path}/r.npz", **start), f"{tmp_path}/c.csv").run()  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"overrides": (Override("opt.gravity", "0,0,-1"),)}, True),
        ({"overrides": (Override("geom/box.mass", "50"),)}, True),
        ({"overrides": (Override("vis.map.force", "3"), Override("geom/box.rgba", "1,1,1,1"))}, False),
        ({}, False),
    ],
)
def test_a_recording_of_other_physics_is_told(swing: Path, tmp_path: Path, change: dict[str, Any], told: bool) -> None:
    Recording(Simulation(swing, duration=0.1), f"{tmp_path}/r.npz").run()
    again = Trace(
        Simulation(FileSource(swing, **change), replay=f"{tmp_path}/r.npz"), f"{tmp_path}/t.csv", probe=["energy"]
    )
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        again.run()
    assert any("other physics" in str(warning.message) for warning in heard) == told


def test_states_are_those_of_a_bare_loop(swing: Path, tmp_path: Path) -> None:
    result = Recording(Simulation(swing, steps=120, qvel={"hinge": 3}), f"{tmp_path}/r.npz").run()
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    data.joint("hinge").qvel = 3
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)
    states = np.load(tmp_path / "r.npz")["states"]
    assert (result.states, result.size, result.simulated) == (121, size, 0.24)
    for state in states:
        expected = np.empty(size)
        mujoco.mj_getState(model, data, expected, mujoco.mjtState.mjSTATE_INTEGRATION)
        assert np.array_equal(state[1:], expected[1:])
        assert state[0] == pytest.approx(data.time)
        mujoco.mj_step(model, data)
