"""Tables in memory have the numbers of the files that a trace writes."""

import re
from pathlib import Path

import numpy as np
import pytest

import mjrun
from mjrun.errors import FailedAssertionError, UnknownNameError

OPTIONS = {"qvel": {"hinge": 3}, "duration": 0.2, "probe": ["energy", "qpos,xpos"]}


@pytest.mark.parametrize("more", [{}, {"every": 7}, {"rate": 100}, {"timestep": 0.001, "integrator": "rk4"}])
def test_a_table_in_memory_is_the_table_in_a_file(swing: Path, tmp_path: Path, more: dict[str, object]) -> None:
    table = mjrun.trace(swing, output=f"{tmp_path}/t.npz", **OPTIONS, **more)  # type: ignore[arg-type]
    alone = mjrun.trace(swing, **OPTIONS, **more)  # type: ignore[arg-type]
    written = mjrun.read_table(tmp_path / "t.npz")
    assert list(table) == list(alone) == list(written)
    assert table.units == alone.units == written.units
    for name in written:
        assert np.array_equal(table[name], written[name])
        assert np.array_equal(alone[name], written[name])


def test_a_simulation_is_traced_as_its_model_is(swing: Path) -> None:
    simulation = mjrun.Simulation(swing, qvel={"hinge": 3}, duration=0.2)
    one, other = mjrun.trace(simulation, probe="qpos"), mjrun.trace(swing, **(OPTIONS | {"probe": "qpos"}))  # type: ignore[arg-type]
    assert all(np.array_equal(one[name], other[name]) for name in other)


def test_wrong_options_are_refused_by_name(swing: Path) -> None:
    with pytest.raises(TypeError, match=re.escape("trace: unknown option 'durtion' (did you mean 'duration'?)")):
        mjrun.trace(swing, durtion=1)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="trace: the simulation has these options: duration, key"):
        mjrun.trace(mjrun.Simulation(swing, steps=1), duration=1, key=0)
    with pytest.raises(UnknownNameError, match="did you mean 'qpos'"):
        mjrun.trace(swing, probe="qpo", steps=1)
    with pytest.raises(FailedAssertionError):
        mjrun.trace(swing, steps=1, assert_="time < 0")
