"""Predictions are what a bare loop of MuJoCo measures, and films of fits show them."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.fitting.free_parameter import free_parameters
from mjrun.fitting.measurements import LogSegment
from mjrun.fitting.outputs import FittedChunkMotion, FitVideo
from mjrun.fitting.prediction import Chunk, ChunkInitialStates, ChunkRolloutInputs, Predictor, chunks
from mjrun.formats.image_and_video_reader import read_video
from mjrun.model import state
from mjrun.options.fit import FitOptions
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.simulation import Simulation
from tests.fitting.logs import NOMINAL, TRUTH, simulate, write_model


def segment(times: np.ndarray, values: np.ndarray, controls: np.ndarray | None = None) -> LogSegment:
    commanded = np.zeros((len(times), 1)) if controls is None else controls[:, None]
    return LogSegment("log", times, values[:, None], commanded)


def predictor(folder: Path, *texts: tuple[str, str], signal: str = "qpos/hinge") -> Predictor:
    simulation = Simulation(str(write_model(folder)))
    parameters = free_parameters(texts, simulation.source, [signal, "ctrl/motor"])
    return Predictor(simulation, [signal], parameters)


def start(model: mujoco.MjModel, angle: float) -> np.ndarray:
    data = mujoco.MjData(model)
    data.qpos[0] = angle
    return state.save(model, data)


def test_a_prediction_with_the_truth_is_the_truth(tmp_path: Path) -> None:
    times, angles = simulate(1.0)
    names = [(f"joint/hinge.{name}", "log:1e-4..1") for name in TRUTH]
    each = predictor(tmp_path, *names)
    (chunk,) = chunks([segment(times, angles)], 1000, each.timestep)
    (predicted,) = each.predict([ChunkRolloutInputs(chunk, tuple(TRUTH.values()), start(each.model, 2.5))])
    np.testing.assert_array_equal(predicted[:, 0], angles)


def test_energies_are_predicted_for_a_model_that_leaves_them_out(tmp_path: Path) -> None:
    each = predictor(tmp_path, ("joint/hinge.damping", "0..1"), signal="energy/total")
    bare = mujoco.MjModel.from_xml_path(str(write_model(tmp_path)))
    bare.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(bare)
    data.qpos[0] = 2.5
    energies = []
    for _ in range(100):
        mujoco.mj_forward(bare, data)
        energies.append(data.energy.sum())
        mujoco.mj_step(bare, data)
    times = np.arange(100) * bare.opt.timestep
    (chunk,) = chunks([segment(times, np.array(energies))], 1000, each.timestep)
    (predicted,) = each.predict([ChunkRolloutInputs(chunk, (NOMINAL["damping"],), start(each.model, 2.5))])
    np.testing.assert_allclose(predicted[:, 0], energies, rtol=1e-12)


def test_samples_between_steps_lie_between_them(tmp_path: Path) -> None:
    times, angles = simulate(0.3, every=1)
    between = times[3:-1:7] + 0.0007
    each = predictor(tmp_path, *[(f"joint/hinge.{name}", "log:1e-4..1") for name in TRUTH])
    late = segment(np.concatenate([[0.0], between]), np.zeros(len(between) + 1))
    (chunk,) = chunks([late], 1000, each.timestep)
    (predicted,) = each.predict([ChunkRolloutInputs(chunk, tuple(TRUTH.values()), start(each.model, 2.5))])
    np.testing.assert_allclose(predicted[1:, 0], np.interp(between, times, angles), rtol=1e-12)


def test_chunks_cover_a_segment_and_share_their_ends() -> None:
    times = np.arange(100) * 0.01
    parts = chunks([segment(times, times)], 30, 0.002)
    assert [part.rows.start for part in parts] == [0, *(part.rows.stop - 1 for part in parts[:-1])]
    assert parts[-1].rows.stop == 100
    for part in parts:
        np.testing.assert_allclose((part.first_step + part.positions) * 0.002, times[part.rows], atol=1e-12)


def test_a_delay_of_a_signal_shifts_what_is_measured(tmp_path: Path) -> None:
    times, angles = simulate(0.5, every=1)
    each = predictor(tmp_path, ("delay:qpos/hinge", "0..0.02"), *[(f"joint/hinge.{n}", "log:1e-4..1") for n in TRUTH])
    assert each.lead == 10
    measured = segment(times[::5], angles[::5])
    part = chunks([measured], 20, each.timestep, each.lead)[1]
    begin = round(part.first_step)
    data = mujoco.MjData(each.model)
    data.qpos[0] = angles[begin]
    data.qvel[0] = (angles[begin] - angles[begin - 1]) / 0.002  # by which a semi-implicit step moves
    (predicted,) = each.predict([ChunkRolloutInputs(part, (0.013, *TRUTH.values()), state.save(each.model, data))])
    expected = np.interp(times[::5][part.rows] - 0.013, times, angles)
    np.testing.assert_allclose(predicted[:, 0], expected, atol=1e-9)


@pytest.mark.parametrize("delayed", ["delay:ctrl/motor", "delay:ctrl/*"])
def test_a_delay_of_a_command_acts_later(tmp_path: Path, delayed: str) -> None:
    commanded = np.where(np.arange(250) < 100, 0.0, 0.5)
    times, angles = simulate(0.5, start=0.0, every=1, controls=np.concatenate([np.zeros(7), commanded])[:250])
    each = predictor(tmp_path, (delayed, "0..0.02"), *[(f"joint/hinge.{n}", "log:1e-4..1") for n in TRUTH])
    log = segment(times, angles, commanded)
    (chunk,) = chunks([log], 1000, each.timestep)
    (predicted,) = each.predict([ChunkRolloutInputs(chunk, (0.014, *TRUTH.values()), start(each.model, 0.0))])
    np.testing.assert_allclose(predicted[:, 0], angles, atol=1e-9)


def test_what_becomes_unstable_is_nan_from_there_on(tmp_path: Path) -> None:
    times, angles = simulate(0.3)
    each = predictor(tmp_path, ("joint/hinge.armature", "log:1e-4..1"))
    data = mujoco.MjData(each.model)
    data.qvel[0] = 1e12
    (chunk,) = chunks([segment(times, angles)], 1000, each.timestep)
    (predicted,) = each.predict([ChunkRolloutInputs(chunk, (0.05,), state.save(each.model, data))])
    assert np.isnan(predicted[1:]).any()


def test_deviations_of_states_are_tangents() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    states = ChunkInitialStates(model)
    assert states.size == 12
    moved = states.moved(state.save(model, data), np.array([1, 0, 0, 0, 0, np.pi / 2, 0, 2, 0, 0, 0, 0.0]))
    state.restore(model, data, moved)
    assert data.qpos[:3].tolist() == [1, 0, 0]
    assert data.qpos[3:] == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    assert data.qvel.tolist() == [0, 2, 0, 0, 0, 0]


SIZE = (64, 48)


def film(folder: Path, measured: np.ndarray, delay: float = 0.0) -> np.ndarray:
    """Frames `(n, 48, 64, 3)` of a model that hangs still, in two logs of half a second with a ghost at `measured`."""
    model = mujoco.MjModel.from_xml_path(str(write_model(folder, **TRUTH)))
    path = folder / "fit.apng"  # which loses nothing
    path.unlink(missing_ok=True)
    options = FitOptions(video=str(path), size=SIZE, camera=["free"])  # not one that keeps the ghost in view
    times = np.arange(51) * 0.01
    logs = [LogSegment(name, times + 3, measured[:, None], np.zeros((51, 1))) for name in "ab"]
    stretches = [FittedChunkMotion(Chunk(log, slice(None), 0, times / 0.002), np.zeros((51, 1))) for log in logs]
    with FitVideo(options, model, ["qpos/hinge"]).writer(model, stretches, [delay], PythonApiReporter()) as writer:
        assert not path.exists()
        writer.publish()
    return np.stack([np.array(frame, int) for frame in read_video(str(path))])


def test_logs_follow_each_other_and_what_was_measured_is_a_ghost(tmp_path: Path) -> None:
    """It turns 0.3 s after the beginning of each log; if measured 0.2 s late, it turned after 0.1 s."""
    turns = np.where(np.arange(51) < 30, 0.0, 1.5)
    hanging, turned, late = film(tmp_path, 0 * turns), film(tmp_path, turns), film(tmp_path, turns, delay=0.2)
    assert len(hanging) == len(turned) == 31  # 1.01 s at 30 frames a second, and the first
    differ = [(np.abs(each - hanging).max(axis=(1, 2, 3)) > 30).tolist() for each in (turned, late)]
    assert differ[0] == [False] * 9 + [True] * 7 + [False] * 9 + [True] * 6
    assert differ[1][:15] == [False] * 3 + [True] * 12


def test_what_makes_no_video_is_refused_before_anything_is_fitted(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(write_model(tmp_path)))
    with pytest.raises(UsageError, match="no position such as qpos/knee is measured"):
        FitVideo(FitOptions(video="fit.mp4"), model, ["qvel/hinge"])
    for options in ({"video": "fit.xyz"}, {"video": "frames/%03d.png"}, {"video": "fit.mp4", "camera": "nose"}):
        with pytest.raises(UsageError, match=r"xyz|single file|nose"):
            FitVideo(FitOptions(**options), model, ["qpos/hinge"])  # type: ignore[arg-type]
