"""Plots of a simulation with varied parameters: a curve for each point, against loops of bare MuJoCo."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjrun.plotting.figure_writer
from mjrun.errors import UnstableError, UsageError
from mjrun.plotting.figure_data import DrawnFigure
from mjrun.simulation.simulation import Simulation
from mjrun.study.varied_plot import VariedPlot
from tests.cases import cases
from tests.study.models import PENDULUM

Drawn = Callable[..., DrawnFigure]


@pytest.fixture
def drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Drawn:
    """Makes a plot of a pendulum in a small size, and returns what is drawn."""
    drawings: list[DrawnFigure] = []
    encoded = mjrun.plotting.figure_writer.encoded
    monkeypatch.setattr(
        mjrun.plotting.figure_writer,
        "encoded",
        lambda drawing, *rest: drawings.append(drawing) or encoded(drawing, *rest),
    )
    monkeypatch.chdir(tmp_path)
    Path("pendulum.xml").write_text(PENDULUM)

    def draw(simulation: Simulation | None = None, **options: object) -> DrawnFigure:
        default = Simulation("pendulum.xml", duration=0.4, qvel={"hinge": 1})
        VariedPlot(simulation or default, "p.png", size=(320, 200), **options).run()  # type: ignore[arg-type]
        return drawings[-1]

    return draw


def energies(timestep: float, speed: float, steps: int) -> np.ndarray:
    """Returns the energy before each step of a bare loop, and after the last [J]."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    model.opt.timestep = timestep
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    data.qvel[0] = speed
    values = list[float]()
    for _ in range(steps + 1):
        mujoco.mj_step(model, data)
        values.append(data.energy.sum())
    return np.array(values)


def test_every_curve_is_that_of_a_bare_loop_with_the_values_of_its_point(drawn: Drawn) -> None:
    (panel,) = drawn(vary={"opt.timestep": "0.02,0.01", "qvel/hinge": "1,2"}, y="energy/total").panels
    names = [f"timestep {step:g} s, hinge {speed} rad/s" for step in (0.02, 0.01) for speed in (1, 2)]
    assert [curve.name for curve in panel.curves] == names
    points = [(0.02, 1, 20), (0.02, 2, 20), (0.01, 1, 40), (0.01, 2, 40)]
    for curve, (timestep, speed, steps) in zip(panel.curves, points, strict=True):
        assert np.array_equal(curve.points.y, energies(timestep, speed, steps))
        assert curve.points.x == pytest.approx(np.arange(steps + 1) * timestep, abs=1e-15)


def test_repeats_have_successive_seeds_and_a_titled_legend_only_their_values(drawn: Drawn) -> None:
    start = Simulation("pendulum.xml", steps=3, perturb=0.1, seed=5)
    (panel,) = drawn(start, repeats=2, y="qvel/hinge", legend_title="seed").panels
    alone = [drawn(start, vary={"seed": str(seed)}, y="qvel/hinge").panels[0].curves[0] for seed in (5, 6)]
    assert [curve.name for curve in panel.curves] == ["5", "6"]
    assert [curve.points.y.tolist() for curve in panel.curves] == [curve.points.y.tolist() for curve in alone]
    assert alone[0].points.y[0] != alone[1].points.y[0]


def test_an_unstable_point_is_drawn_up_to_there_and_the_others_as_a_whole(drawn: Drawn) -> None:
    swung = Simulation("pendulum.xml", steps=50, qvel={"hinge": 1})
    with pytest.raises(UnstableError, match="unstable at step") as caught:
        drawn(swung, vary={"joint/hinge.stiffness": "0,1e6"}, y="qpos/hinge")
    (result,) = caught.value.results
    assert 0 < caught.value.step < 50
    assert result.points == {"joint/hinge.stiffness=0": 51, "joint/hinge.stiffness=1e6": caught.value.step + 1}
    assert "at the point joint/hinge.stiffness=1e6" in caught.value.spelled(str)
    assert Path("p.png").is_file()


def test_models_may_vary_and_all_their_files_are_inputs(drawn: Drawn) -> None:
    Path("other.xml").write_text(PENDULUM.replace("0 0 -1", "0 0 -2"))
    options = {"vary": {"model": "pendulum.xml,other.xml"}, "y": "qpos/hinge"}
    near, far = (curve.points.y for curve in drawn(**options).panels[0].curves)
    assert near[-1] != far[-1]
    job = VariedPlot(Simulation("pendulum.xml"), "p.png", **options)  # type: ignore[arg-type]
    assert {path for _, path in job.inputs} == {"pendulum.xml", "other.xml"}


@cases("options, message")
def test_bad_input_is_found_before_anything_is_made(drawn: Drawn, options: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message.replace("--vary", ".*vary")):
        drawn(**options)
    assert not Path("p.png").exists()
