"""Demonstrations as motions, compared with a bare loop over the same states."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.errors import FileError, UsageError
from mjrun.simulation.demonstration import names_demonstration
from tests.demonstration_files import PLAIN, positions_at, recorded_states, write_demonstrations

pytestmark = pytest.mark.filterwarnings("ignore::mjrun.errors.MjrunWarning")  # about what is missing

STATES = recorded_states(6, first=0.052)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return write_demonstrations(tmp_path / "d.hdf5", {"demo_1": STATES, "demo_2": recorded_states(3)})


def bare(file: Path) -> mujoco.MjModel:
    (file.parent / "m.xml").write_text(PLAIN)
    return mujoco.MjModel.from_xml_path(str(file.parent / "m.xml"))


def remarks(simulation: mjrun.Simulation) -> list[str]:
    return simulation.remarks(simulation.load())


def test_a_model_in_a_demonstration_moves_as_recorded(file: Path) -> None:
    table = mjrun.trace(f"{file}:demo_1", probe=["qpos", "qvel", "xpos"], rate=20)
    bodies, _ = positions_at(bare(file), STATES)
    np.testing.assert_array_equal(table["time"], np.arange(6) / 20)
    np.testing.assert_array_equal(np.column_stack([table[name] for name in table if "qpos/" in name]), STATES[:, 1:9])
    np.testing.assert_array_equal(np.column_stack([table[name] for name in table if "qvel/" in name]), STATES[:, 9:])
    for body, index in (("arm", 1), ("cube_main", 2)):
        np.testing.assert_array_equal(
            np.column_stack([table[f"xpos/{body}/{axis}"] for axis in "xyz"]), bodies[:, index]
        )


def test_states_are_replayed_on_another_model_too(file: Path) -> None:
    bare(file)
    one, other = f"{file}:demo_1", str(file.parent / "m.xml")
    expected = mjrun.trace(one, probe="xpos")
    for simulation in (mjrun.Simulation(other, replay=one), mjrun.Simulation(Path(one), replay=one)):
        table = mjrun.trace(simulation, probe="xpos")
        assert all(np.array_equal(table[name], expected[name]) for name in expected)


def test_between_states_positions_are_interpolated_or_held(file: Path) -> None:
    angles, times = STATES[:, 1], np.arange(26) / 100
    linear = mjrun.trace(f"{file}:demo_1", probe="qpos[turn]", rate=100)
    np.testing.assert_allclose(linear["qpos/turn"], np.interp(times, times[::5], angles), rtol=1e-12)
    held = mjrun.trace(mjrun.Simulation(f"{file}:demo_1", replay_interpolation="hold"), probe="qpos[turn]", rate=100)
    np.testing.assert_array_equal(held["qpos/turn"], np.repeat(angles, 5)[:26])


def test_times_may_be_replaced_by_a_rate(tmp_path: Path) -> None:
    states = recorded_states(3)
    states[:, 0] = 0
    path = write_demonstrations(tmp_path / "d.hdf5", {"demo": states})
    with pytest.raises(UsageError, match=r"d\.hdf5:demo, row 1: time 0 follows 0; times must ascend"):
        mjrun.trace(str(path))
    np.testing.assert_array_equal(mjrun.trace(str(path), replay_rate=10, rate=10)["time"], [0, 0.1, 0.2])


def test_the_file_is_an_input_of_the_simulation(file: Path) -> None:
    simulation = mjrun.Simulation(f"{file}:demo_1")
    assert simulation.tables == [("demonstration", file)]
    assert simulation.inputs == [
        ("model", file),
        ("file of the model", file.parent / "meshes/link.obj"),
        ("demonstration", file),
    ]
    assert [facts["path"] for facts in simulation.fingerprints] == [str(file)]
    copied = simulation.with_snapshot()
    file.unlink()
    assert len(mjrun.trace(copied, rate=20)["time"]) == 6


def test_ghosts_follow_demonstrations(file: Path) -> None:
    motion = mjrun.Simulation(f"{file}:demo_1").motion(Path(f"{file}:demo_2"), bare(file))
    assert len(motion.steps) == 51


def test_a_file_with_one_demonstration_needs_no_name(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5", {"demo": recorded_states()})
    assert names_demonstration(path)
    assert names_demonstration(Path(f"{path}:demo"))
    assert len(mjrun.trace(str(path), rate=20)["time"]) == 5
    mjrun.Trace(mjrun.Simulation(str(path)), str(tmp_path / "t.h5"), probe="qpos").run()
    assert not names_demonstration(tmp_path / "t.h5")
    again = mjrun.Simulation(str(path), replay=str(tmp_path / "t.h5"))
    assert len(mjrun.trace(again, rate=20)["time"]) == 5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"controller": print},
            "replay and controller exclude each other.*\n.*demo_1 is a demonstration, whose states",
        ),
        ({"push": "arm=0/0/1@0+1"}, "replay and push exclude each other"),
        ({"replay": "no.hdf5:demo_1"}, "no.hdf5: no such file"),
        ({"replay_mode": "controls"}, "demo_1 has no controls to replay; those of the model are ctrl/turn"),
        ({"map": "time=t"}, "map applies to tables, not to the states of a demonstration"),
        ({"quat": "xyzw"}, "quat applies to tables, not to the states of a demonstration"),
    ],
)
def test_contradictory_options_are_refused(file: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises((UsageError, FileError)) as caught:
        mjrun.trace(f"{file}:demo_1", **options)
    assert re.search(message, caught.value.spelled(str), re.DOTALL)


def test_a_demonstration_of_another_model_is_refused(file: Path) -> None:
    with pytest.raises(
        UsageError, match=r"of another model: its states have 16 numbers\nthose of this model have 3: tim"
    ):
        mjrun.trace(mjrun.Simulation("scene:pendulum", replay=f"{file}:demo_1"))


def test_activations_behind_velocities_are_read_if_there_are_any(tmp_path: Path) -> None:
    model = PLAIN.replace("<motor", '<general dyntype="filter" dynprm="1"')
    states = np.column_stack([recorded_states(3), [0.1, 0.2, 0.3]])
    path = write_demonstrations(tmp_path / "d.hdf5", {"demo": states}, model=model)
    table = mjrun.trace(str(path), probe=["act", "qvel"], rate=20)
    np.testing.assert_array_equal(table["act/turn"], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(table["qvel/turn"], states[:, 9])


def hand(states: np.ndarray, path: Path) -> np.ndarray:
    """Returns the positions of the hand in these states, of a model beside `path`."""
    (path / "meshes").mkdir(exist_ok=True)
    write_demonstrations(path / "m.hdf5")
    return positions_at(bare(path / "m.hdf5"), states)[1][:, 0]


@pytest.mark.parametrize(("key", "shift"), [("robot0_eef_pos", 0), ("robot0_right_eef_pos", 0), ("ee_pos", 1)], ids=str)
def test_the_difference_from_observed_poses_is_reported(tmp_path: Path, key: str, shift: int) -> None:
    observed = hand(STATES, tmp_path)
    observed = np.add(np.roll(observed, -shift, axis=0), [0, 0, 2e-3])
    path = write_demonstrations(tmp_path / "d.hdf5", {"demo": STATES}, observations={key: observed})
    (made,) = [text for text in remarks(mjrun.Simulation(str(path))) if "version of MuJoCo" in text]
    assert made == (
        f"{path}:demo does not state its version of MuJoCo (robosuite 1.4.1), and poses are computed by MuJoCo "
        f"{mujoco.mj_versionString()}: they differ from its observations by up to 0.002 m, in {key}"
    )


@pytest.mark.parametrize(
    ("version", "offset", "expected"),
    [
        (
            "3.2.6",
            0.0,
            "was recorded with MuJoCo 3.2.6, and poses .* differ from its observations by up to 0 m, in cube",
        ),
        (mujoco.mj_versionString(), 1e-5, ""),
        (mujoco.mj_versionString(), 0.5, "they differ from its observations by up to 0.5 m, in cube_pos"),
    ],
)
def test_the_version_that_recorded_it_is_reported_if_it_matters(
    tmp_path: Path, version: str, offset: float, expected: str
) -> None:
    observations = {"cube_pos": STATES[:, 2:5] + [offset, 0, 0], "image": np.zeros((6, 2, 2, 3), np.uint8)}
    attributes = {"mujoco_version": version}
    write_demonstrations(tmp_path / "d.hdf5", {"demo": STATES}, observations=observations, attributes=attributes)
    texts: Sequence[str] = [text for text in remarks(mjrun.Simulation(str(tmp_path / "d.hdf5"))) if "poses" in text]
    assert len(texts) == bool(expected)
    for text in texts:
        assert re.search(expected, text)


def test_remarks_tell_what_is_missing(file: Path) -> None:
    assert remarks(mjrun.Simulation(f"{file}:demo_1")) == [
        f"{file}:demo_1: its time 0.052 s is time 0 here",
        f"{file}:demo_1 does not state its version of MuJoCo (robosuite 1.4.1), and poses are computed by MuJoCo "
        f"{mujoco.mj_versionString()}: it has no observations to compare them with",
    ]
