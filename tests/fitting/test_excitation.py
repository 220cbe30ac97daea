"""Inputs that make parameters identifiable, played by a bare loop of MuJoCo."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import MjrunWarning, UnidentifiableError, UsageError
from mjrun.fitting.excitation import ExcitationResult, excite
from mjrun.fitting.fit import Fit
from mjrun.simulation.simulation import Simulation
from tests.fitting.logs import NOISE, PENDULUM, TRUTH, simulate, write_log

LIMITED = PENDULUM.replace('axis="0 1 0"', 'axis="0 1 0" range="-60 60"').replace(
    'joint="hinge"/></act', 'joint="hinge" ctrlrange="-4 4" forcerange="-3 3"/></act'
)
FREE = (("joint/hinge.damping", "log:1e-3..1"), ("joint/hinge.armature", "log:1e-3..1"))
SECONDS, SPEED = 1.2, 3.0


def pendulum_in(folder: Path) -> Fit:
    (folder / "pendulum.xml").write_text(LIMITED.format(**TRUTH))
    simulation = Simulation(str(folder / "pendulum.xml"), duration=SECONDS)
    chirp = str(folder / "chirp.csv")
    return Fit(simulation, free=FREE, excite=chirp, excite_noise=NOISE, velocity_limit=SPEED)


@pytest.fixture
def pendulum(tmp_path: Path) -> Fit:
    return pendulum_in(tmp_path)


@pytest.fixture(scope="module")
def excited(tmp_path_factory: pytest.TempPathFactory) -> ExcitationResult:
    """The result of exciting the pendulum."""
    return excite(pendulum_in(tmp_path_factory.mktemp("excited")))


def played(path: str) -> np.ndarray:
    """The control of every step of a table of 100 Hz."""
    table = np.genfromtxt(path, delimiter=",", names=True, deletechars="")
    assert table.dtype.names == ("time", "ctrl/motor")
    np.testing.assert_allclose(np.diff(table["time"]), 0.01, atol=1e-12)
    return np.repeat(table["ctrl/motor"], 5)


def limits_of(result: ExcitationResult) -> dict[str, tuple[float | None, float | None]]:
    return {each.name: (each.least, each.most) for each in result.motion}


def test_a_bare_loop_stays_within_limits_and_moves_as_told(excited: ExcitationResult) -> None:
    result, controls = excited, played(excited.files[0])
    model = mujoco.MjModel.from_xml_string(LIMITED.format(**TRUTH))
    data = mujoco.MjData(model)
    states: list[tuple[float, float]] = []
    for control in controls[: round(SECONDS / 0.002)]:
        data.ctrl[0] = control
        mujoco.mj_step(model, data)
        states.append((data.qpos[0], data.qvel[0]))
        assert abs(data.actuator_force[0]) < 3
    told = {each.name: (each.low, each.high) for each in result.motion}
    for column, name in zip(np.array(states).T, ("qpos/hinge", "qvel/hinge"), strict=True):
        np.testing.assert_allclose([min(column.min(), 0), max(column.max(), 0)], told[name], rtol=2e-2)
    assert limits_of(result)["qvel/hinge"] == (-SPEED, SPEED)
    assert np.abs(np.array(states)[:, 1]).max() < SPEED
    assert np.abs(controls).max() <= 4
    assert controls[0] == controls[-1] == 0


@pytest.mark.slow
def test_a_fit_of_what_it_makes_knows_as_much_as_was_expected(
    tmp_path: Path, pendulum: Fit, excited: ExcitationResult
) -> None:
    result = excited
    times, angles = simulate(SECONDS, start=0.0, controls=played(result.files[0]))
    angles = angles + np.random.default_rng(0).normal(0, NOISE, len(angles))
    columns = {"time": times, "qpos/hinge": angles, "ctrl/motor": played(result.files[0])[::5][: len(times)]}
    data = (str(write_log(tmp_path / "log.csv", columns)),)
    wrong = (("joint/hinge.damping", "0.3"), ("joint/hinge.armature", "0.05"))
    worse = Simulation(pendulum.simulation.model, set=wrong)
    fitted = Fit(worse, data=data, free=FREE, starts=1, holdout=0).run()
    for expected, found in zip(result.parameters, fitted.parameters, strict=True):
        width = expected.high - expected.low
        assert 0.5 * width < found.high - found.low < 2.5 * width
        assert abs(found.value - TRUTH[found.path.rpartition(".")[2]]) < width


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_and_another_another(pendulum: Fit) -> None:
    short = replace(pendulum.simulation, duration=0.3)
    path = Path(excite(replace(pendulum, simulation=short)).files[0])
    first = path.read_bytes()
    excite(replace(pendulum, simulation=short))
    assert path.read_bytes() == first
    excite(replace(pendulum, simulation=replace(short, seed=1)))
    assert path.read_bytes() != first


def test_what_no_input_tells_is_refused_and_nothing_is_written(pendulum: Fit) -> None:
    free = (*FREE, ("actuator/motor.gear[0]", "0.5..2"), ("geom/rod.mass", "0.5..2"))
    with pytest.raises(UnidentifiableError, match=r"do not distinguish "):
        excite(replace(pendulum, free=(*free, ("opt.gravity[2]", "-12..-6")), velocity_limit=None))
    assert pendulum.excite is not None
    assert not Path(pendulum.excite).exists()


def test_limits_that_no_input_keeps_are_reported(pendulum: Fit) -> None:
    start = replace(pendulum.simulation, qpos={"hinge": 0.9})
    with pytest.raises(UsageError, match="even the weakest chirp exceeds a limit: qvel/hinge reaches"):
        excite(replace(pendulum, simulation=start, velocity_limit=0.01))


def test_limits_hold_at_the_corners_of_the_bounds(pendulum: Fit) -> None:
    """Where damping and armature may be next to nothing, chirps must be weaker; a bare loop looks at each corner."""
    heavy = replace(
        pendulum.simulation, set=(("joint/hinge.damping", "0.9"), ("joint/hinge.armature", "0.5")), duration=2
    )
    result = excite(replace(pendulum, simulation=heavy, free=(("joint/hinge.damping", "0.01..1"), FREE[1])))
    assert result.corners == 4
    controls = played(result.files[0])
    for damping in (0.01, 1):
        for armature in (1e-3, 1):
            text = LIMITED.format(**{**TRUTH, "damping": damping, "armature": armature})
            model = mujoco.MjModel.from_xml_string(text)
            data = mujoco.MjData(model)
            for control in controls[:1000]:
                data.ctrl[0] = control
                mujoco.mj_step(model, data)
                assert abs(data.qvel[0]) < SPEED
                assert abs(data.qpos[0]) < np.pi / 3


def test_contacts_that_begin_are_reported(tmp_path: Path, pendulum: Fit) -> None:
    wall = '<geom name="wall" type="box" size=".01 1 1" pos=".08 0 0"/></worldbody>'
    text = LIMITED.format(**TRUTH).replace("</worldbody>", wall)
    (tmp_path / "pendulum.xml").write_text(text)
    with pytest.warns(MjrunWarning, match="contacts begin"):
        result = excite(replace(pendulum, simulation=replace(pendulum.simulation, duration=2)))
    assert len(result.contacts) == 1
    assert result.contacts[0].startswith("rod and wall touch from ")


def test_nothing_is_measured_yet(pendulum: Fit) -> None:
    of_fits = {
        "output": "fitted.xml",
        "video": "fitted.mp4",
        "holdout_data": ("log.csv",),
        "starts": 2,
        "loss": "huber",
    }
    for name, value in of_fits.items():
        with pytest.raises(UsageError, match=f"precedes measurements: leave {name} out"):
            excite(replace(pendulum, **{name: value}))
    with pytest.raises(UsageError, match="precedes measurements: leave the tables out"):
        excite(replace(pendulum, data=("log.csv",)))
    with pytest.raises(UsageError, match="map does not apply to excite, which precedes measurements"):
        excite(replace(pendulum, simulation=replace(pendulum.simulation, map=("time=t",))))
    with pytest.raises(UsageError, match="excite_noise requires excite"):
        replace(pendulum, excite=None)


def test_a_fit_and_the_design_of_an_input_are_not_taken_for_each_other(pendulum: Fit) -> None:
    with pytest.raises(UsageError, match="excite designs an input instead"):
        pendulum.run()
    with pytest.raises(UsageError, match="excite is missing"):
        excite(replace(pendulum, excite=None, excite_noise=1e-3, velocity_limit=None))
