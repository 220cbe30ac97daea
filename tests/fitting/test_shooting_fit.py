"""Shooting finds what a bare loop was simulated with."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.fitting.gauss_newton import EXPLAINED, GaussNewton
from mjrun.fitting.information import intervals
from mjrun.fitting.measurements import LogSegment, first_noise
from mjrun.fitting.shooting_fit import OriginalAndBestSolutions, ShootingFit
from mjrun.fitting.shooting_problem import together, with_noise
from mjrun.model.names import control_names
from mjrun.probe.fields import field_probe
from tests.fitting.box import FRICTION, RATES, SIGNALS, box_shooting, exact_box_log, write_box
from tests.fitting.cart import TRUTH as CART_TRUTH
from tests.fitting.cart import cart_log, cart_shooting
from tests.fitting.logs import NOISE, TRUTH
from tests.fitting.problems import THREE, predictor_of, segments, shooting, shooting_of, solved

SLIDE = """<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 .1" friction=".1"/>
    <body pos="0 0 .05">
      <joint name="x" type="slide" axis="1 0 0" damping="{damping}"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <joint name="pitch" axis="0 1 0"/>
      <geom name="box" type="box" size=".1 .08 .05" mass="1" friction="{mu}"/>
    </body>
  </worldbody>
</mujoco>"""
SCENES = Path(__file__).resolve().parents[2] / "scenes"


def test_without_noise_it_finds_the_truth() -> None:
    shoot, parameters = shooting(THREE)
    start = np.array([each.first_coordinate for each in parameters])
    search = shoot.search(segments(2.0, exact=True), [start], np.array([1e-4]))
    values = [each.value(c) for each, c in zip(parameters, search.best.coordinates, strict=True)]
    assert values == pytest.approx(list(TRUTH.values()), rel=2e-4)
    assert len(search.best.chunks) == 1
    assert search.best.cost < 1e-2 < search.own.cost


def test_with_noise_it_finds_the_truth_and_the_noise() -> None:
    solution, parameters = solved()
    values = [each.value(c) for each, c in zip(parameters, solution.coordinates, strict=True)]
    assert values == pytest.approx(list(TRUTH.values()), rel=0.1)
    assert solution.noise[0] == pytest.approx(NOISE, rel=0.1)
    assert solution.cost == pytest.approx(1)


def test_short_stretches_lead_where_whole_segments_do_not() -> None:
    """A cart that is not measured, from parameters far off, to the truth of a bare loop; the ways are reported."""
    log, _ = cart_log()
    shoot, _, _, parameters = cart_shooting()
    search = shoot.search([log], [np.array([0.05, 0.05]), np.array([0.6, 0.4])], np.array([1e-4]))
    values = [each.value(c) for each, c in zip(parameters, search.best.coordinates, strict=True)]
    assert values == pytest.approx(CART_TRUTH, rel=0.01)
    assert search.ways[0] == "whole segments"


def fitted(
    path: Path, free: tuple[str, str], signals: list[str], log: LogSegment, controls: Sequence[str] = ()
) -> float:
    """Returns the value that a search from that of the model finds."""
    shoot, predictor, _, parameters = shooting_of(path, [free], signals, controls, log)
    noise = first_noise([log.values], predictor.rotations)
    best = shoot.search([log], [np.array([parameters[0].first_coordinate])], noise).best
    return parameters[0].value(best.coordinates[0])


@pytest.mark.parametrize(("signals", "every"), [(SIGNALS + RATES, 1), (SIGNALS + RATES, 3), (SIGNALS, 1)])
def test_logs_without_noise_give_exact_parameters_despite_impacts(
    tmp_path: Path, signals: list[str], every: int
) -> None:
    """Whole segments jump with every change of the friction, but each state follows exactly from the one before."""
    times, rows = exact_box_log()
    log = LogSegment("log", times[::every], rows[::every, : len(signals)], np.zeros((len(times[::every]), 0)))
    path, free = write_box(tmp_path, 0.9), ("geom/box.friction[0]", "0.1..1")
    assert fitted(path, free, signals, log) == pytest.approx(FRICTION, rel=1e-8)


def test_logs_of_six_digits_give_parameters_to_these_digits_despite_impacts(tmp_path: Path) -> None:
    """Velocities that are differences of rounded positions are too inexact to begin a long motion in them."""
    times, rows = exact_box_log()
    values = np.array([[float(f"{value:.6g}") for value in row] for row in rows[:, : len(SIGNALS)]])
    log = LogSegment("log", times, values, np.zeros((len(times), 0)))
    path, free = write_box(tmp_path, 0.9), ("geom/box.friction[0]", "0.1..1")
    shoot, predictor, _, parameters = shooting_of(path, [free], SIGNALS, [], log)
    noise, start = first_noise([log.values], predictor.rotations), np.array([parameters[0].first_coordinate])
    best = shoot.search([log], [start], noise).best
    known = intervals(with_noise(best, best.observed_noise), parameters, 0.95, 0)
    assert best.estimate is None
    assert known.low[0] == pytest.approx(FRICTION, rel=1e-5)
    assert known.high[0] == pytest.approx(FRICTION, rel=1e-5)


def test_exact_logs_of_jumping_motions_keep_the_loss(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The loss of the fit decides how the noise of its residuals is estimated."""
    times, rows = exact_box_log()
    log = LogSegment("log", times, rows, np.zeros((len(times), 0)))
    path, free = write_box(tmp_path, 0.9), ("geom/box.friction[0]", "0.1..1")
    _, predictor, starting, parameters = shooting_of(path, [free], SIGNALS + RATES, [], log)
    shoot = ShootingFit(predictor, parameters, starting, "huber")
    monkeypatch.setattr(shoot, "_is_stopped", lambda solution: True)
    noise, start = first_noise([log.values], predictor.rotations), np.array([parameters[0].first_coordinate])
    whole = shoot.cut([log])
    first = shoot.look(whole, start, shoot.guessed(whole, start), noise)
    shoot._follow_states(search := OriginalAndBestSolutions(first, first), [log], start, noise)
    assert search.best.estimate
    assert search.best.loss == "huber"


@pytest.mark.parametrize(
    ("scene", "fields", "old", "new", "free", "truth"),
    [
        # The last digits of the damping of a bat decide how it touches a pole.
        ("pinata", ("qpos", "qvel"), 'damping="1"', 'damping="3"', ("joint/swing.damping", "log:0.05..20"), 1.0),
        # Sensors of force jump even between neighbouring states.
        (
            "humanoid",
            ("qpos", "qvel", "sensordata"),
            'damping=".8"',
            'damping="2"',
            ("scale:joint/*.damping", "0.1..2"),
            0.4,
        ),
    ],
)
def test_exact_logs_of_scenes_give_exact_parameters(
    tmp_path: Path, scene: str, fields: tuple[str, ...], old: str, new: str, free: tuple[str, str], truth: float
) -> None:
    """By a bare loop, with noise on all controls."""
    text, path = (SCENES / f"{scene}.xml").read_text(), tmp_path / "other.xml"
    path.write_text(text.replace(old, new))
    model = mujoco.MjModel.from_xml_string(text)
    data, instant = mujoco.MjData(model), mujoco.MjData(model)
    times, rows = list[float](), list[np.ndarray]()
    controls = np.random.default_rng(0).normal(0, 0.1, (300, model.nu))
    for control in controls:
        data.ctrl[:] = control
        mujoco.mj_copyData(instant, model, data)
        mujoco.mj_forward(model, instant)
        times.append(data.time)
        rows.append(np.concatenate([getattr(instant, field) for field in fields]))
        mujoco.mj_step(model, data)
    signals = [column.name for field in fields for column in field_probe(model, field).columns]
    log = LogSegment("log", np.array(times), np.array(rows), controls)
    commands = [f"ctrl/{name}" for name in control_names(model)]
    assert fitted(path, free, signals, log, commands) == pytest.approx(truth, rel=1e-6)


@pytest.mark.parametrize("damping", [0.0, 0.02])
def test_positions_that_a_model_without_damping_nearly_follows_step_by_step_are_not_exact(
    tmp_path: Path, damping: float
) -> None:
    """In a step of 2 ms, a deceleration of 0.04 m/s² moves a box by less than the rounding of simulations."""
    path = tmp_path / "slide.xml"
    path.write_text(SLIDE.format(mu=0.9, damping=0))
    model = mujoco.MjModel.from_xml_string(SLIDE.format(mu=FRICTION, damping=damping))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = (0, 0.12, 0.2), (2.2, 0, 3)
    times, rows = list[float](), list[np.ndarray]()
    for _ in range(250):
        times.append(data.time)
        rows.append(data.qpos.copy())
        mujoco.mj_step(model, data)
    log = LogSegment("log", np.array(times), np.array(rows), np.zeros((250, 0)))
    free, signals = ("geom/box.friction[0]", "0.1..1"), ["qpos/x", "qpos/z", "qpos/pitch"]
    shoot, predictor, _, parameters = shooting_of(path, [free], signals, [], log)
    noise, start = first_noise([log.values], predictor.rotations), np.array([parameters[0].first_coordinate])
    whole = shoot.cut([log])
    first = shoot.look(whole, start, shoot.guessed(whole, start), noise)
    shoot._follow_states(search := OriginalAndBestSolutions(first, first), [log], start, noise)
    if damping:
        assert search.best.estimate is None
    else:
        assert parameters[0].value(search.best.coordinates[0]) == pytest.approx(FRICTION, rel=1e-8)


@pytest.mark.slow
def test_a_fit_never_ends_worse_than_it_began() -> None:
    """A box that is thrown and slides: the model is the truth, and so is where the search begins."""
    shoot, log, noise, parameters = box_shooting()
    truth = np.array([parameters[0].coordinate(FRICTION)])
    search = shoot.search([log], [truth], noise)
    assert search.best.cost <= search.own.cost * 1.001
    assert abs(search.best.coordinates[0] - truth[0]) < 0.03


@pytest.mark.slow
def test_intervals_of_rough_motions_contain_the_truth() -> None:
    """A box that slides and rattles, by a bare loop, from one wrong start: searches from there alone end alike, and
    exclude the truth."""
    shoot, log, noise, parameters = box_shooting()
    best = shoot.search([log], [np.array([0.4])], noise).best
    known = intervals(with_noise(best, best.observed_noise), parameters, 0.95, 0)
    assert known.low[0] < FRICTION < known.high[0]


def test_contacts_do_not_keep_a_fit_from_the_truth(tmp_path: Path) -> None:
    """A damped pendulum beside a box that falls and slides, by a bare loop; both parameters begin far off."""
    mjcf = """<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1" friction="{}"/>
    <body pos="0 0 .1"><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
    <geom type="box" size=".1 .1 .1" mass="1" friction=".01"/></body>
    <body pos="0 2 1"><joint name="hip" axis="0 1 0" damping="{}"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".03" mass="1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(mjcf.format(0.4, 0.05))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[0] = (0, 0.1, 1), 2
    times, rows = list[float](), list[np.ndarray]()
    for step in range(250):
        if step % 5 == 0:
            times.append(data.time)
            rows.append(data.qpos.copy())
        mujoco.mj_step(model, data)

    path = tmp_path / "model.xml"
    path.write_text(mjcf.format(0.8, 0.9))
    log = LogSegment("log", np.array(times), np.array(rows), np.zeros((len(times), 0)))
    free, signals = (
        (("geom/floor.friction[0]", "0.05..1"), ("joint/hip.damping", "0..1")),
        ["qpos/x", "qpos/z", "qpos/hip"],
    )
    shoot, predictor, _, parameters = shooting_of(path, free, signals, [], log)
    noise = first_noise([log.values], predictor.rotations)
    starts = [np.array([each.first_coordinate for each in parameters]), np.array([0.1, 0.4])]
    best = shoot.search([log], starts, noise).best
    known = intervals(with_noise(best, best.observed_noise), parameters, 0.95, 0)
    assert best.reduced < EXPLAINED
    truth = np.array([0.4, 0.05])
    assert np.abs(np.array(known.low) - truth).max() < 1e-6
    assert (np.array(known.low) <= truth * (1 + 1e-6)).all()
    assert (truth * (1 - 1e-6) <= np.array(known.high)).all()


def test_stages_are_longer_and_longer_stretches() -> None:
    shoot, _ = shooting(THREE)
    counts = [len(parts) for _, parts in shoot.stages(segments())]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] > 1


def test_longer_stretches_begin_in_the_states_of_shorter_ones() -> None:
    """Half of the shorter stretches begin where a longer one does; no stretch begins elsewhere."""
    shoot, _ = shooting(THREE)
    (_, short), (_, longer), *_ = shoot.stages(segments())
    coordinates = np.full(3, 0.5)
    before = shoot.look(short, coordinates, shoot.guessed(short, None) + 1e-3, np.array([NOISE]))
    np.testing.assert_array_equal(shoot.guessed(longer, None, before), before.states[::2])


def test_a_stage_ends_where_the_model_explains_the_log() -> None:
    shoot, _ = shooting(THREE)
    parts = shoot.cut(segments(1.0), 24)
    problem = shoot._problem(parts, np.full(3, 0.5), shoot.guessed(parts, None), np.array([NOISE]))
    stage, last = together(predictor_of(shoot), [GaussNewton(problem).approach(), GaussNewton(problem).minimize()])
    assert last.cost < stage.cost
    assert last.reduced < stage.reduced <= EXPLAINED


@pytest.mark.parametrize("seed", [4, 9, 12])
def test_the_states_of_the_true_model_are_found_in_fast_motion(tmp_path: Path, seed: int) -> None:
    """Random torques turn a double pendulum by half a revolution within a few rows, which are no parabolas."""
    path = tmp_path / "pendulum.xml"
    path.write_text("""<mujoco><option timestep=".002"/><worldbody><body>
        <joint name="a" axis="0 1 0" damping=".02"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".5"/>
        <body pos="0 0 -.3"><joint name="b" axis="0 1 0" damping=".02"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".3"/></body></body></worldbody>
        <actuator><motor name="a" joint="a" gear="16"/></actuator></mujoco>""")
    model, generator, noise, every = mujoco.MjModel.from_xml_path(str(path)), np.random.default_rng(seed), 1e-3, 10
    data, times, angles, controls = mujoco.MjData(model), list[float](), list[np.ndarray](), list[np.ndarray]()
    for _ in range(60):
        data.ctrl[:] = generator.normal()
        times.append(data.time)
        angles.append(data.qpos + generator.normal(0, noise, 2))
        controls.append(data.ctrl.copy())
        mujoco.mj_step(model, data, every)

    log = LogSegment("log", np.array(times), np.array(angles), np.array(controls))
    log = replace(log, **{name: getattr(log, name)[20:] for name in ("times", "values", "controls")})
    free = [("joint/b.damping", "0.001..1")]
    shoot, *_ = shooting_of(path, free, ["qpos/a", "qpos/b"], ["ctrl/a"], log)
    assert shoot.follow(shoot.cut([log]), None, np.full(2, noise)).reduced < EXPLAINED
