"""Whole fits, from tables to files."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import MjrunWarning, UnidentifiableError, UnimprovedFitError, UsageError
from mjrun.fitting.fit import Fit
from mjrun.model.sources.file import FileSource
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.simulation import Simulation
from tests.fitting.logs import NOISE, PENDULUM, TRUTH, noisy, simulate, write_log, write_model
from tests.fitting.problems import THREE


@pytest.fixture
def pendulum(tmp_path: Path) -> Simulation:
    return Simulation(str(write_model(tmp_path)))


@pytest.fixture
def near(tmp_path: Path) -> Simulation:
    """A pendulum from which a fit takes a quarter of the iterations."""
    return Simulation(str(write_model(tmp_path, damping=0.08, armature=0.012, frictionloss=0.03)))


def log(folder: Path, **columns: np.ndarray) -> list[str]:
    times, angles = simulate(3.0)
    return [str(write_log(folder / "log.csv", {"time": times + 17, "qpos/hinge": noisy(angles), **columns}))]


def test_a_fit_finds_what_the_log_was_made_with(tmp_path: Path, pendulum: Simulation) -> None:
    output, comparison, ranges = (tmp_path / name for name in ("fitted.xml", "comparison.csv", "ranges.yaml"))
    files = {"output": str(output), "comparison": str(comparison), "ranges": str(ranges)}
    fit = Fit(pendulum, data=log(tmp_path), free=THREE, starts=1)
    result = replace(fit, **files).run()  # type: ignore[arg-type]
    found = {each.path.rpartition(".")[2]: each for each in result.parameters}
    for name, truth in TRUTH.items():
        assert found[name].value == pytest.approx(truth, rel=0.15)
        assert found[name].low < found[name].value < found[name].high
    (signal,) = result.signals
    assert signal.noise == pytest.approx(NOISE, rel=0.1)
    errors = (signal.fitted, signal.nominal, signal.holdout_fitted, signal.holdout_nominal)
    fitted, nominal, held_fitted, held_nominal = (float(each or np.nan) for each in errors)
    assert fitted < 0.01 < nominal
    assert held_fitted < 0.05 < held_nominal
    assert sorted(result.files) == sorted(files.values())
    model = FileSource(output).load()
    assert [model.dof_damping[0], model.dof_armature[0], model.dof_frictionloss[0]] == [
        each.value for each in result.parameters
    ]


@pytest.mark.parametrize(
    "driving",
    [
        {"controller": print},
        {"control_dt": 0.1},
        {"push": ["bob=1/0/0@1+0.1"]},
        {"ctrl_noise": 1},
        {"ctrl_noise_time": 1},
        {"perturb": 1},
        {"replay_mode": "controls"},
        {"quat": "xyzw"},
        {"duration": 1},
        {"steps": 10},
    ],
)
def test_options_of_which_a_fit_makes_no_use_are_refused(tmp_path: Path, pendulum: Simulation, driving: dict) -> None:
    with pytest.raises(UsageError, match=f"^{next(iter(driving))} does not apply to"):
        Fit(Simulation(pendulum.model, **driving), data=log(tmp_path), free=THREE).run()


def test_initial_values_and_controls_that_the_log_replaces_are_reported(tmp_path: Path) -> None:
    times, angles = simulate(0.6)
    columns = {"time": times, "qpos/hinge": noisy(angles), "ctrl/motor": np.zeros(len(times))}
    data = [str(write_log(tmp_path / "log.csv", columns)), str(tmp_path / "passive.csv")]
    write_log(tmp_path / "passive.csv", {each: columns[each] for each in ("time", "qpos/hinge")})
    model = str(write_model(tmp_path, **{**TRUTH, "damping": 0.2}))
    simulation = Simulation(model, qpos={"hinge": 1}, qvel={"hinge": 1}, ctrl={"motor": 0})
    idle = [f"{name} does nothing: the measurements set it" for name in ("qpos hinge", "qvel hinge", "ctrl motor")]
    for count in (1, 2):  # the second log needs the control
        result = Fit(simulation, data=data[:count], free=THREE[:1], starts=1, holdout=0).run()
        assert result.remarks[: 4 - count] == idle[: 4 - count]
        assert len(result.remarks) == 4 - count


def test_remarks_spell_options(tmp_path: Path) -> None:
    times, angles = simulate(0.6)
    columns = {"time": times, "qpos/hinge": np.degrees(noisy(angles)), "qvel/hinge": np.gradient(angles, times)}
    data = [str(write_log(tmp_path / "log.csv", columns))]
    model = str(write_model(tmp_path, **{**TRUTH, "damping": 0.2}))
    noise = {"qpos/hinge": 1e3, "qvel/hinge": 0.1}
    fit = Fit(Simulation(model), data=data, free=THREE[:1], noise=noise, starts=1, holdout=0)
    assert "add map 'qpos/hinge=qpos/hinge*pi/180'" in fit.run().remarks[0]


@pytest.mark.parametrize(
    ("given", "other"),
    [({"camera": "free"}, "video"), ({"size": (64, 48)}, "video"), ({"excite_noise": 0.01}, "excite")],
)
def test_options_of_outputs_that_are_not_made_are_refused(
    tmp_path: Path, pendulum: Simulation, given: dict, other: str
) -> None:
    with pytest.raises(UsageError, match=f"^{next(iter(given))} requires {other}, "):
        Fit(pendulum, data=log(tmp_path), free=THREE, **given).run()


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_a_signal_that_rests_or_is_missing_in_a_part_causes_no_warning(tmp_path: Path, loss: str) -> None:
    """A velocity that rests until the held-out part, one that ends before it, and a log of nothing that is fitted."""
    path = write_model(tmp_path, **{**TRUTH, "damping": 0.2})
    still = '<body><joint name="{0}" type="slide" axis="1 0 0"/><geom size=".1" contype="0" conaffinity="0"/></body>'
    path.write_text(
        path.read_text().replace("</worldbody>", still.format("idle") + still.format("lost") + "</worldbody>")
    )
    times, angles = simulate(1.0)
    is_held = times > 0.745
    lost = np.where(is_held, np.nan, 1e-3 * np.random.default_rng(0).normal(size=len(times)))
    columns = {"time": times, "qpos/hinge": noisy(angles), "qpos/idle": 0.01 * is_held, "qpos/lost": lost}
    data = [str(write_log(tmp_path / "log.csv", columns))]
    fit = Fit(Simulation(str(path)), data=data, free=THREE[:1], starts=1, holdout=0.25, loss=loss)
    result = fit.run()
    assert [(each.name, each.holdout_fitted is None) for each in result.signals] == [
        ("qpos/hinge", False),
        ("qpos/lost", True),
    ]
    other = [str(write_log(tmp_path / "other.csv", {"time": times, "qvel/hinge": times}))]
    with pytest.raises(UsageError, match="holdout_data measures nothing that is fitted: qpos/hinge"):
        replace(fit, holdout=0.2, holdout_data=other).run()


@pytest.mark.slow
def test_a_model_that_is_edited_while_it_is_fitted_changes_nothing(tmp_path: Path, near: Simulation) -> None:
    class Editor(PythonApiReporter):
        def progress(self, what: str, done: int, total: int) -> None:
            write_model(tmp_path, damping=3.0, armature=0.5)

    times, angles = simulate(1.0)
    data = [str(write_log(tmp_path / "log.csv", {"time": times, "qpos/hinge": noisy(angles)}))]
    fit = Fit(near, data=data, free=THREE[:2], starts=2, holdout=0, output=str(tmp_path / "fitted.xml"))
    before = fit.run()
    written = (tmp_path / "fitted.xml").read_bytes()
    edited = fit.run(Editor())
    assert FileSource(Path(str(near.model))).load().dof_damping[0] == 3.0
    assert edited.parameters == before.parameters  # from random starts, too: the seed is the same
    assert (tmp_path / "fitted.xml").read_bytes() == written


def test_a_whole_log_is_held_out_where_asked(tmp_path: Path, near: Simulation) -> None:
    times, angles = simulate(1.0)
    more, others = simulate(0.6, start=-1.0)
    data = [str(write_log(tmp_path / "one.csv", {"time": times, "qpos/hinge": noisy(angles)}))]
    held = [str(write_log(tmp_path / "two.csv", {"time": more, "qpos/hinge": noisy(others, 1)}))]
    result = Fit(near, data=data, holdout_data=held, free=THREE, starts=1).run()
    assert result.rows == len(times)
    assert result.signals[0].holdout_fitted is not None
    assert result.signals[0].holdout_fitted < 0.02
    with pytest.raises(UsageError, match="is both fitted and held out"):
        Fit(near, data=data, holdout_data=data, free=THREE).run()
    with pytest.raises(UsageError, match="holdout and holdout_data exclude each other: both say what is held out"):
        Fit(near, data=data, holdout_data=held, holdout=0.1, free=THREE)


def test_what_the_log_does_not_tell_is_refused_and_nothing_is_written(tmp_path: Path, pendulum: Simulation) -> None:
    free = (*THREE[:1], ("actuator/motor.gear[0]", "0.5..2"))
    output = tmp_path / "fitted.xml"
    with pytest.raises(UnidentifiableError, match=r"do not determine actuator/motor\.gear\[0\]"):
        Fit(pendulum, data=log(tmp_path), free=free, starts=1, output=str(output)).run()
    assert not output.exists()


def test_a_fit_that_predicts_no_better_is_refused(tmp_path: Path) -> None:
    """The model is right as it is, and the log has noise: what is fitted to that predicts no better but by chance."""
    truth = Simulation(str(write_model(tmp_path, **TRUTH)))
    output = tmp_path / "fitted.xml"
    with pytest.raises(UnimprovedFitError, match="does not explain the rest better"):
        Fit(truth, data=log(tmp_path), free=THREE[:2], starts=1, output=str(output)).run()
    assert not output.exists()


@pytest.mark.slow
def test_what_the_model_lacks_is_warned_of_in_text_and_report(tmp_path: Path) -> None:
    """A rod of another mass: the interval of the damping excludes the truth, and the report says why."""
    model = write_model(tmp_path, **{**TRUTH, "damping": 0.2})
    model.write_text(model.read_text().replace('mass="1"', 'mass="1.5"'))
    times, angles = simulate(1.0)
    data = [str(write_log(tmp_path / "log.csv", {"time": times, "qpos/hinge": noisy(angles)}))]
    fit = Fit(Simulation(str(model)), data=data, free=THREE[:1], starts=1, holdout=0)
    with pytest.warns(MjrunWarning, match="beyond the noise of the log"):
        result = fit.run()
    assert result.reduced_chi2 > 2
    assert any("reduced χ²" in each for each in result.remarks)
    assert all(each.isprintable() for remark in result.remarks for each in remark.splitlines())
    with pytest.warns(MjrunWarning, match="beyond the noise of the log"):
        again = replace(fit, noise=(("qpos/*", "0.0005"),)).run()
    assert again.reduced_chi2 > 4 * result.reduced_chi2


@pytest.mark.parametrize(
    ("seconds", "every", "seed", "friction", "is_warned"), [(3.0, 5, 0, 0.012, True), (0.4, 10, 10, 0.0, False)]
)
def test_a_small_lack_shows_in_a_long_log_and_chance_is_no_lack_in_a_short_one(
    tmp_path: Path, seconds: float, every: int, seed: int, friction: float, is_warned: bool
) -> None:
    """The reduced χ² is 1.9 in 300 rows with friction that the model lacks, and 2.4 in 20 rows of a right model."""
    times, angles = simulate(seconds, every=every, frictionloss=friction)
    data = [str(write_log(tmp_path / "log.csv", {"time": times, "qpos/hinge": noisy(angles, seed)}))]
    model = write_model(tmp_path, damping=0.2, armature=TRUTH["armature"], frictionloss=0.0)
    fit = Fit(Simulation(str(model)), data=data, free=THREE[:1], starts=1, holdout=0)
    with pytest.warns(MjrunWarning, match="beyond the noise of the log") if is_warned else nullcontext():
        result = fit.run()
    low, high = result.parameters[0].low, result.parameters[0].high
    assert (low <= TRUTH["damping"] <= high) != is_warned


def test_a_log_that_no_values_explain_is_refused(tmp_path: Path) -> None:
    """Its sign is flipped."""
    commanded = np.repeat(0.8 * np.sin(np.arange(80) * 0.05), 5)
    times, angles = simulate(0.8, start=0.0, controls=commanded)
    columns = {"time": times, "qpos/hinge": -noisy(angles), "ctrl/motor": commanded[::5]}
    output = tmp_path / "fitted.xml"
    fit = Fit(
        Simulation(str(write_model(tmp_path, **{**TRUTH, "damping": 0.2}))),
        data=[str(write_log(tmp_path / "log.csv", columns))],
        free=(THREE[0], THREE[2]),
        starts=1,
        output=str(output),
    )
    with pytest.raises(UnimprovedFitError, match="nothing was written"):
        fit.run()
    assert not output.exists()


def test_a_delay_is_found(tmp_path: Path, near: Simulation) -> None:
    steps = 900
    commanded = np.repeat(0.8 * np.sin(np.arange(steps // 5) * 0.05) * (np.sin(np.arange(steps // 5) / 18) > 0), 5)
    times, angles = simulate(1.8, start=0.0, controls=np.concatenate([np.zeros(12), commanded])[:steps])
    columns = {"time": times, "qpos/hinge": noisy(angles), "ctrl/motor": commanded[::5]}
    data = [str(write_log(tmp_path / "log.csv", columns))]
    free = (("delay:ctrl/motor", "0..0.1"), *THREE)
    result = Fit(near, data=data, free=free, starts=1).run()
    assert result.parameters[0].value == pytest.approx(0.024, abs=0.002)


def test_too_little_is_reported_before_anything_is_fitted(tmp_path: Path, pendulum: Simulation) -> None:
    times = np.arange(17) * 0.01
    data = [str(write_log(tmp_path / "log.csv", {"time": times, "qpos/hinge": np.sin(times)}))]
    with pytest.raises(UsageError, match="too few for 3 parameters"):
        Fit(pendulum, data=data, free=THREE, holdout=0).run()


@pytest.mark.slow
def test_outliers_do_not_lead_a_robust_fit_astray(tmp_path: Path, near: Simulation) -> None:
    times, angles = simulate(1.0)
    data = [str(write_log(tmp_path / "clean.csv", {"time": times, "qpos/hinge": noisy(angles)}))]
    clean = Fit(near, data=data, free=THREE, starts=1, holdout=0).run()
    generator = np.random.default_rng(5)
    spoiled = noisy(angles) + np.where(generator.random(len(angles)) < 0.05, generator.normal(0, 0.3, len(angles)), 0)
    data = [str(write_log(tmp_path / "spoiled.csv", {"time": times, "qpos/hinge": spoiled}))]
    robust = Fit(near, data=data, free=THREE, starts=1, holdout=0, loss="cauchy").run()
    assert robust.signals[0].noise == pytest.approx(NOISE, rel=0.2)
    assert robust.loss == "cauchy"
    spread = 1.4826 * np.median(np.abs(spoiled - np.median(spoiled)))
    assert robust.signals[0].fitted == pytest.approx(NOISE / spread, rel=0.2)  # by medians, as its noise is
    for one, other in zip(clean.parameters, robust.parameters, strict=True):
        assert other.high - other.low < 3 * (one.high - one.low)
        assert abs(other.value - TRUTH[one.path.rpartition(".")[2]]) < other.high - other.low


def test_parameters_that_are_all_at_bounds_are_refused(tmp_path: Path) -> None:
    """The friction of the model and of the log is 0, which a logarithmic range has not."""
    model = str(write_model(tmp_path, **{**TRUTH, "frictionloss": 0.0}))
    times, angles = simulate(1.0, frictionloss=0.0)
    data = [str(write_log(tmp_path / "log.csv", {"time": times, "qpos/hinge": angles}))]
    free = (("joint/hinge.frictionloss", "log:0.01..0.1"),)
    with pytest.raises(UnimprovedFitError, match="nothing was written"):
        Fit(Simulation(model), data=data, free=free, starts=1, holdout=0).run()


def test_a_parameter_that_is_truly_at_its_bound_is_fitted_and_reported_there(tmp_path: Path) -> None:
    times, angles = simulate(3.0, damping=0.0, frictionloss=0.0)
    for start, values, holdout in ((0.05, noisy(angles), 0.2), (0.0, angles, 0)):
        model = str(write_model(tmp_path, **{**TRUTH, "frictionloss": 0.0, "damping": start}))
        data = [str(write_log(tmp_path / "log.csv", {"time": times, "qpos/hinge": values}))]
        fit = Fit(Simulation(model), data=data, free=(("joint/hinge.damping", "0..1"),), starts=1, holdout=holdout)
        (damping,) = fit.run().parameters
        assert (damping.bound, damping.value) == ("low", pytest.approx(0, abs=1e-3))


def test_regions_where_the_model_explodes_are_avoided_and_told(tmp_path: Path) -> None:
    """With stiffness far beyond what the timestep allows, where a start is, the explicit spring diverges."""
    path = write_model(tmp_path)
    path.write_text(path.read_text().replace("implicitfast", "Euler"))
    free = (("joint/hinge.stiffness", "log:1e-3..1e9"), THREE[0])
    times, angles = simulate(0.6, armature=0.05)
    data = [str(write_log(tmp_path / "log.csv", {"time": times, "qpos/hinge": noisy(angles)}))]
    fit = Fit(Simulation(str(path)), data=data, free=free, starts=4, holdout=0)
    with pytest.warns(MjrunWarning, match=r"unstable with joint/hinge\.stiffness=.*failed in all"):
        result = fit.run()
    assert result.parameters[0].value < 0.1
    assert any("becomes unstable" in each for each in result.remarks)


def test_a_ball_joint_is_fitted_by_quaternions_of_either_sign_and_any_length(tmp_path: Path) -> None:
    """A log of a bare loop whose quaternions jump between q and -q, are not of unit length, and lack some rows."""
    text = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body>
      <joint name="socket" type="ball" damping="{}"/>
      <geom type="capsule" fromto="0 0 0 .1 0 -.5" size=".03" mass="1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text.format(0.05))
    data, generator = mujoco.MjData(model), np.random.default_rng(0)
    data.qpos[:], data.qvel[:] = [0.6, 0.8, 0, 0], [0, 2, 5]
    rows: list[np.ndarray] = []
    for step in range(600):
        if step % 5 == 0:
            noise = generator.normal(0, 1e-3, 4)
            rows.append((data.qpos + noise) * generator.choice([-1, 1]) * generator.uniform(0.95, 1.05))
        mujoco.mj_step(model, data)
    logged = np.array(rows)
    logged[40:44, 2] = np.nan
    columns = {"time": np.arange(120) * 0.01} | {f"qpos/socket/q{c}": logged[:, i] for i, c in enumerate("wxyz")}
    (tmp_path / "ball.xml").write_text(text.format(0.2))
    fit = Fit(
        Simulation(str(tmp_path / "ball.xml")),
        data=[str(write_log(tmp_path / "log.csv", columns))],
        free=(("joint/socket.damping", "log:1e-3..1"),),
        starts=1,
    )
    result = fit.run()
    assert result.parameters[0].value == pytest.approx(0.05, rel=0.02)
    assert {each.noise for each in result.signals} == {result.signals[0].noise}
    assert result.signals[0].noise == pytest.approx(1e-3 * np.sqrt(3 / 4), rel=0.15)  # three of four directions
    assert result.remarks == [f"{fit.data[0]}: 4 samples missing and skipped"]


def test_sensors_and_torques_are_signals(tmp_path: Path) -> None:
    """What sensors of a joint and an accelerometer feel tells mass, damping and the motor's gain."""
    text = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping="{}"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0 0 -.5" size=".02" mass="{}"/><site name="tip" pos="0 0 -.5"/>
      </body></worldbody><actuator><motor name="motor" joint="hinge" gear="{}"/></actuator>
      <sensor><jointpos name="angle" joint="hinge"/><accelerometer name="imu" site="tip"/>
      <jointactuatorfrc name="torque" joint="hinge"/></sensor></mujoco>"""
    truth = (0.05, 1.3, 0.8)
    model = mujoco.MjModel.from_xml_string(text.format(*truth))
    data, generator = mujoco.MjData(model), np.random.default_rng(0)
    rows: list[list[float]] = []
    for step in range(750):
        data.ctrl[0] = 2 * np.sin(0.05 * (step // 5))
        mujoco.mj_forward(model, data)
        if step % 5 == 0:
            noise = generator.normal(0, 1, 5) * [1e-3, 0.02, 0.02, 0.02, 0.005]
            rows.append([data.time, data.ctrl[0], *(data.sensordata[:5] + noise)])
        mujoco.mj_step(model, data)
    names = ["time", "ctrl/motor", "sensor/angle", *(f"sensor/imu/{c}" for c in "xyz"), "sensor/torque"]
    (tmp_path / "model.xml").write_text(text.format(0.2, 1.0, 1.0))
    free = (("joint/hinge.damping", "log:1e-3..1"), ("geom/rod.mass", "0.5..2"), ("actuator/motor.gear[0]", "0.5..2"))
    log = write_log(tmp_path / "log.csv", dict(zip(names, np.array(rows).T, strict=True)))
    result = Fit(Simulation(str(tmp_path / "model.xml")), data=[str(log)], free=free, starts=1).run()
    assert [each.name for each in result.signals] == names[2:]
    assert [each.value for each in result.parameters] == pytest.approx(truth, rel=0.03)


def test_what_the_model_lacks_is_reported_and_so_is_what_explodes(tmp_path: Path, pendulum: Simulation) -> None:
    """In degrees no damping explains the swing; and with great stiffness an explicit spring diverges."""
    times, angles = simulate(1.0)
    data = [str(write_log(tmp_path / "log.csv", {"time": times, "qpos/hinge": np.degrees(noisy(angles))}))]
    with pytest.raises((UnidentifiableError, UnimprovedFitError), match=r"times its noise(.|\n)*other units"):
        Fit(pendulum, data=data, free=THREE[:1], starts=1).run()


def test_time_is_that_of_the_log(tmp_path: Path, pendulum: Simulation) -> None:
    with pytest.raises(UsageError, match=r"opt\.timestep: the log determines it"):
        Fit(pendulum, data=log(tmp_path), free=(("opt.timestep", "0.001..0.01"),)).run()


def test_a_parameter_that_shows_only_at_an_end_of_its_range_is_found(tmp_path: Path) -> None:
    """The friction of a box on a slope of 20°, by a bare loop, from a model in which the box sticks."""
    mjcf = """<mujoco><option gravity="3.355 0 -9.218" cone="elliptic" impratio="1000"/><worldbody>
    <geom type="plane" size="9 9 .1" friction=".01"/>
    <body pos="0 0 .1"><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
    <geom name="box" type="box" size=".1 .1 .1" mass="1" friction="{}"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(mjcf.format(0.2))
    data, generator = mujoco.MjData(model), np.random.default_rng(0)
    rows = np.empty((60, 3))
    for row in rows:
        row[:] = data.time, *(data.qpos + generator.normal(0, 5e-3, 2))
        mujoco.mj_step(model, data, 5)
    path = tmp_path / "box.xml"
    path.write_text(mjcf.format(0.9))
    log = write_log(tmp_path / "log.csv", {"time": rows[:, 0], "qpos/x": rows[:, 1], "qpos/z": rows[:, 2]})
    free = (("geom/box.friction[0]", "0.1..1"),)
    (friction,) = Fit(Simulation(str(path)), data=[str(log)], free=free, starts=1, holdout=0).run().parameters
    assert friction.low < 0.2 < friction.high
    assert friction.high - friction.low < 0.15


def test_a_precise_signal_decides_though_its_rows_are_too_few_to_show_its_noise(tmp_path: Path) -> None:
    """High frequencies of a fast motion at 25 Hz look like noise of 0.1 rad/s; residuals show that it is 1e-5."""
    free, names = (("joint/hinge.damping", "0.01..0.5"),), ("time", "qpos/hinge", "qvel/hinge")
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(**TRUTH))
    data, generator = mujoco.MjData(model), np.random.default_rng(0)
    data.qpos[0] = 2.5
    rows: list[np.ndarray] = []
    for step in range(2000):
        if step % 20 == 0:
            rows.append(np.array([data.time, data.qpos[0], data.qvel[0]]))
        mujoco.mj_step(model, data)
    simulation = Simulation(str(write_model(tmp_path, **{**TRUTH, "damping": 0.08})))
    measured = np.array(rows) + generator.normal(0, 1, (len(rows), 3)) * [0, 0.02, 1e-5]
    log = write_log(tmp_path / "log.csv", dict(zip(names, measured.T, strict=True)))
    (found,) = Fit(simulation, data=[str(log)], free=free, confidence=0.99).run().parameters
    assert found.low < TRUTH["damping"] < found.high
    assert found.value == pytest.approx(TRUTH["damping"], abs=5e-7)


def test_a_ball_that_settles_on_the_floor_leads_no_exact_log_astray(tmp_path: Path) -> None:
    """The first rows of the ball, which touches the floor, are no parabola; a bare loop has made the log."""
    mjcf = """<mujoco><option timestep=".01"/><worldbody><geom type="plane" size="2 2 .1"/>
    <body pos="0 0 1"><joint name="hinge" axis="0 1 0" damping="{}"/><geom size=".05" pos=".3 0 0"/></body>
    <body pos="1 0 .1"><freejoint name="ball"/><geom size=".1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(mjcf.format(0.1))
    data, rows = mujoco.MjData(model), list[np.ndarray]()
    for _ in range(100):
        rows.append(np.array([data.time, data.qpos[0], data.qpos[3], data.qvel[0], data.qvel[3]]))
        mujoco.mj_step(model, data)
    names = ("time", "qpos/hinge", "qpos/ball/z", "qvel/hinge", "qvel/ball/vz")
    columns = dict[str, np.ndarray](zip(names, np.transpose(rows), strict=True))
    path = tmp_path / "model.xml"
    path.write_text(mjcf.format(0.3))
    data_files = [str(write_log(tmp_path / "log.csv", columns))]
    result = Fit(Simulation(str(path)), data=data_files, free=(("joint/hinge.damping", "0.01..1"),), starts=1).run()
    assert result.parameters[0].value == pytest.approx(0.1, rel=1e-6)


@pytest.mark.parametrize("is_exact", [True, False])
def test_an_undetermined_mass_may_have_any_value_within_its_bounds(tmp_path: Path, is_exact: bool) -> None:
    """A pendulum without friction swings alike with any mass, and derivatives of exact logs are only rounding."""
    path = write_model(tmp_path, damping=0.0, armature=0.0, frictionloss=0.0)
    path.write_text(path.read_text().replace('mass="1"', 'mass="1.3"'))
    times, angles = simulate(3.0, damping=0.0, armature=0.0, frictionloss=0.0)
    table = write_log(tmp_path / "log.csv", {"time": times, "qpos/hinge": angles if is_exact else noisy(angles)})
    fit = Fit(Simulation(str(path)), data=[str(table)], free=[("geom/rod.mass", "0.5..2")], holdout=0, starts=1)
    with pytest.warns(MjrunWarning, match="do not determine"):
        (mass,) = replace(fit, allow_unidentifiable=True).run().parameters
    assert (mass.low, mass.high) == pytest.approx((0.5, 2.0))


def test_a_trapdoor_that_rests_at_its_limit_in_the_held_out_part_is_judged_by_the_rest(tmp_path: Path) -> None:
    """Both models predict its rest more exactly than they explain its fall."""
    text = """<mujoco><worldbody><body>
        <joint name="door" axis="0 1 0" damping="{}" range="-10 30" limited="true"/>
        <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03" mass="1"/>
        </body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text.format(0.1))
    data, rows = mujoco.MjData(model), list[list[float]]()
    data.qpos[:], data.qvel[:] = -0.15, -1
    for _ in range(750):
        rows.append([data.time, data.qpos[0]])
        mujoco.mj_step(model, data)
    times, angles = np.array(rows).T
    path, table = tmp_path / "door.xml", tmp_path / "log.csv"
    path.write_text(text.format(0.3))
    write_log(table, {"time": times, "qpos/door": angles})
    fit = Fit(Simulation(str(path)), data=[str(table)], free=[("joint/door.damping", "log:0.005..2")], starts=1)
    with pytest.warns(MjrunWarning, match="held-out data are not sensitive to the parameters"):
        result = fit.run()
    assert result.parameters[0].value == pytest.approx(0.1, rel=1e-6)
