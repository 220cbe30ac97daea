"""Regression on simulated logs: least squares agree where motion is smooth, and bare loops know the truth elsewhere."""

from collections.abc import Generator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.fitting.information import all_information, intervals
from mjrun.fitting.measurements import LogSegment, first_noise
from mjrun.fitting.shooting_fit import ShootingFit
from mjrun.fitting.shooting_problem import (
    UNLIKELY,
    Advanced,
    Floats,
    RoughMotionEstimate,
    Simulating,
    Solution,
    Unknowns,
    loss_weights,
    together,
    with_noise,
)
from mjrun.fitting.simulated_regression import RegressionSearch, _away_from_neighbours, _Products, _Round
from mjrun.model.override import Override
from tests.fitting.logs import correlated
from tests.fitting.problems import THREE, predictor_of, segments, shooting, shooting_of, solved

SLIDE = """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1" friction="{1}"/>
    <body pos="0 0 .05">
      <joint name="x" type="slide" axis="1 0 0" damping="{0}"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <geom type="box" size=".05 .05 .05" mass="0.5" friction="0.3"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="x"/></actuator>
</mujoco>"""
DAMPING, FRICTION, NOISE = 0.1, 0.4, 1e-3
FREE = (("joint/x.damping", "0..1"), ("geom/floor.friction[0]", "0.05..1"))
EVERY, ROWS = 5, 200


def slide_log(seed: int, damping: float = DAMPING, stiffness: float = 0.0, share: float = 0.0) -> LogSegment:
    """A box that a motor pushes until it slides, again and again, by a bare loop of MuJoCo.

    Args:
      share: correlation of the noise of consecutive rows.
    """
    model = mujoco.MjModel.from_xml_string(SLIDE.format(damping, FRICTION))
    model.jnt_stiffness[0] = stiffness
    data, generator = mujoco.MjData(model), np.random.default_rng(seed)
    frequency = generator.uniform(0.7, 1.3)
    times, places, controls = list[float](), list[float](), list[float]()
    for _ in range(ROWS):
        data.ctrl[0] = 3.5 * np.sign(np.sin(2 * np.pi * frequency * data.time)) * (0.6 + 0.4 * np.sin(data.time))
        times.append(data.time)
        places.append(data.qpos[0])
        controls.append(data.ctrl[0])
        for _ in range(EVERY):
            mujoco.mj_step(model, data)
    errors = correlated(share, (ROWS, 1), seed) if share else generator.normal(size=(ROWS, 1))
    values = np.array(places)[:, None] + NOISE * errors
    return LogSegment("log", np.array(times), values, np.array(controls)[:, None])


def slide_shooting(
    folder: Path, log: LogSegment, free: Sequence[tuple[str, str]] = FREE, damping: float = 1.6 * DAMPING
) -> tuple[ShootingFit, list]:
    model = folder / "slide.xml"
    model.write_text(SLIDE.format(damping, 1.6 * FRICTION))
    shoot, _, _, parameters = shooting_of(model, free, ["qpos/x"], ["ctrl/motor"], log)
    return shoot, parameters


def search_of(
    shoot: ShootingFit,
    log: LogSegment,
    coordinates: np.ndarray,
    noise: float,
    seed: int = 0,
    advanced: Advanced | None = None,
) -> RegressionSearch:
    """Returns a search of the whole log around `coordinates`."""
    (whole,) = shoot.cut([log])
    first = replace(whole, rows=slice(0, 9), positions=whole.positions[:9])
    states = shoot.guessed([whole], coordinates)
    opening, problem = (shoot._problem([part], coordinates, states, np.array([noise])) for part in (first, whole))
    return RegressionSearch(problem, opening, seed, advanced)


def _bumps(knots: int, count: int) -> np.ndarray:
    """Returns smooth curves that add up to 1, `(knots, count)`."""
    distance = np.linspace(0, knots - 1, count) - np.arange(knots)[:, None]
    return np.where(np.abs(distance) < 1, np.cos(np.pi / 2 * distance) ** 2, 0.0)


def regressed(shoot: ShootingFit, search: RegressionSearch) -> tuple[Unknowns, RoughMotionEstimate]:
    ((nearest, estimate),) = together(predictor_of(shoot), [search.estimate()])
    assert estimate
    return nearest, estimate


def test_where_motion_is_smooth_it_agrees_with_least_squares(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pendulum, from draws among which it moves nearly linearly: about the same values and errors."""
    monkeypatch.setattr("mjrun.fitting.simulated_regression.WIDE", 0.03)
    monkeypatch.setattr("mjrun.fitting.simulated_regression.PART", 64)  # several in this log
    solution, parameters = solved()
    shoot, _ = shooting(THREE)
    nearest, estimate = regressed(shoot, search_of(shoot, segments()[0], solution.coordinates, solution.noise[0]))
    errors = np.sqrt(np.diag(np.linalg.inv(all_information(solution, parameters))))
    middle = estimate.draws.mean(axis=0)
    assert (np.abs(middle - solution.coordinates) < 1.5 * errors).all()
    assert estimate.draws.std(axis=0) == pytest.approx(errors, rel=0.5)
    assert (np.abs(nearest.coordinates - middle) < 0.3 * errors).all()
    assert estimate.probability > 0.05


@pytest.mark.parametrize(
    ("loss", "outliers", "wave", "count", "is_likely"),
    [
        ("linear", 0, 0.0, 250, True),
        ("linear", 8, 0.0, 250, False),
        ("huber", 8, 0.0, 250, True),
        ("linear", 0, 5.0, 250, False),
        ("linear", 0, 5.0, 60, False),
    ],
)
def test_outliers_and_misfits_show_beside_a_rough_motion(
    loss: str, outliers: int, wave: float, count: int, is_likely: bool
) -> None:
    """`count` simulations differ by smooth curves of 100 standard deviations, with knots every 15 rows.

    Some rows of the log are off by 20, or all by a wave between these knots, which is no sum of such curves.
    """
    shoot, _ = shooting(THREE)
    shoot._loss = loss
    (log,) = segments()
    generator, rows = np.random.default_rng(0), len(log.times)
    curves = 100 * np.cumsum(generator.normal(size=(count, 20)), axis=1) @ _bumps(20, rows)
    measured = generator.normal(size=rows) - 100 * np.cumsum(generator.normal(size=20)) @ _bumps(20, rows)
    measured[generator.choice(rows, outliers, replace=False)] += 20
    measured += wave * np.sin(2 * np.pi * np.linspace(0, 19, rows))
    search = search_of(shoot, log, np.full(3, 0.5), 1.0)
    residuals = curves - measured
    weights = loss_weights(loss, _away_from_neighbours(residuals[0][:, None]))[:, 0]
    drawn = _Round(np.zeros((count, 3)), np.pad(residuals, ((0, 0), (0, 3))), np.append(weights, np.ones(3)))
    assert (search._probability(drawn) >= UNLIKELY) == is_likely


@pytest.mark.parametrize(("share", "wave", "is_noise"), [(0.8, 0.0, True), (0.5, 0.0, True), (0.0, 5.0, False)])
def test_correlated_noise_explains_a_log_and_a_misfit_is_no_noise(share: float, wave: float, is_noise: bool) -> None:
    """Simulations differ by smooth curves as above, and a wave between their knots is as correlated as noise."""
    shoot, _ = shooting(THREE)
    (log,) = segments()
    generator, rows, count = np.random.default_rng(0), len(log.times), 100
    curves = 100 * np.cumsum(generator.normal(size=(1 + count, 20)), axis=1) @ _bumps(20, rows)
    measured = curves[0] + wave * np.sin(2 * np.pi * np.linspace(0, 19, rows)) + correlated(share, (rows,), 0)
    search = search_of(shoot, log, np.full(3, 0.5), 1.0)
    drawn = _Round(np.zeros((count, 3)), np.pad(curves[1:] - measured, ((0, 0), (0, 3))), np.ones(rows + 3))
    search._noise = search._likeliest_noise(drawn)
    assert search._noise.correlations.any()
    if is_noise:
        assert search._noise.correlations == pytest.approx([share], abs=0.15)
    search._whiten(drawn)
    assert search._has_white_rest(drawn.residuals) == is_noise


def test_a_robust_loss_ignores_an_outlier_in_the_first_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fourth value of a pendulum's log, to which its initial state is guessed, is wrong by 50 mrad."""
    monkeypatch.setattr("mjrun.fitting.simulated_regression.WIDE", 0.03)
    solution, parameters = solved()
    (log,) = segments()
    values = log.values.copy()
    values[3] += 0.05
    log = replace(log, values=values)
    shoot, _ = shooting(THREE, log)
    shoot._loss = "huber"
    end = shoot._regressed(shoot.cut([log]), solution.coordinates, solution.noise)
    assert end.estimate
    errors = np.sqrt(np.diag(np.linalg.inv(all_information(solution, parameters))))
    assert (np.abs(end.estimate.draws.mean(axis=0) - solution.coordinates) < 3 * errors).all()


@pytest.mark.slow
def test_a_box_that_sticks_and_slides_shows_its_friction_and_damping(tmp_path: Path) -> None:
    """Intervals contain the truth and exclude the values of the model, 60 % above it."""
    log = slide_log(0)
    shoot, parameters = slide_shooting(tmp_path, log)
    start = np.array([each.first_coordinate for each in parameters])
    best = shoot.search([log], [start], np.array([NOISE])).best
    known = intervals(with_noise(best, best.observed_noise), parameters, 0.95, 0)
    assert known.low[0] < DAMPING < known.high[0] < 1.6 * DAMPING
    assert known.low[1] < FRICTION < known.high[1] < 1.05 * FRICTION
    assert best.estimate
    assert best.estimate.is_likely


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "free", "start"),
    [({"stiffness": 10.0}, FREE, [0.16, 0.6]), ({"damping": 1.0}, FREE[1:], [0.4])],
    ids=["spring", "damping"],
)
def test_a_log_of_another_system_is_unlikely(
    tmp_path: Path, change: dict[str, float], free: Sequence[tuple[str, str]], start: list[float]
) -> None:
    """A spring or damping that the model lacks holds the box, and its friction cannot compensate for that."""
    log = slide_log(0, **change)
    shoot, _ = slide_shooting(tmp_path, log, free)
    _, estimate = regressed(shoot, search_of(shoot, log, np.array(start), NOISE))
    assert not estimate.is_likely
    other = shoot._regressed(shoot.cut([log]), np.array(start), np.array([NOISE])).estimate
    assert other
    assert other.correlations is None


@pytest.mark.slow
def test_correlated_noise_beside_contacts_is_no_misfit(tmp_path: Path) -> None:
    log = slide_log(0, share=0.8)
    shoot, _ = slide_shooting(tmp_path, log)
    noise_of_log = first_noise([log.values])
    assert noise_of_log[0] < 0.6 * NOISE
    estimate = shoot._regressed(shoot.cut([log]), np.array([0.16, 0.6]), noise_of_log).estimate
    assert estimate
    assert estimate.correlations == pytest.approx([0.8], abs=0.15)
    assert estimate.is_likely
    assert estimate.lack is None
    assert (
        np.abs(estimate.draws.mean(axis=0) - [DAMPING, (FRICTION - 0.05) / 0.95]) < 2.5 * estimate.draws.std(axis=0)
    ).all()


def test_a_direction_is_weighted_by_the_covariance_of_others() -> None:
    """Unlike simulations and noise of a known covariance: the same as by its dense inverse, and a known size shows."""
    generator, count, numbers, size = np.random.default_rng(0), 200, 300, 0.7
    roots, slopes, effect = (generator.normal(size=(n, numbers)) for n in (3, 2, 1))
    effect += 50 * slopes[:1]
    rest = 9 * generator.normal(size=(count, 3)) @ roots
    rest -= rest.mean(axis=0)
    log = size * effect[0] + 20 * roots[0] + generator.normal(size=numbers)
    logs = rest + generator.normal(size=rest.shape)
    vectors = np.concatenate([slopes, effect, log[None]])
    others = np.concatenate([vectors, logs])
    products = _Products(rest @ rest.T, rest @ others.T, vectors @ others.T)
    inverse = np.linalg.inv(rest.T @ rest / count + np.eye(numbers))
    reach = np.array([100.0, 200.0])
    normal = slopes @ inverse @ slopes.T + np.diag(1 / reach**2)
    compensation = products.compensation(reach)
    np.testing.assert_allclose(compensation, np.linalg.solve(normal, slopes @ inverse @ effect[0]), rtol=1e-6)
    found, deviations = products.score(compensation)
    left = effect[0] - compensation @ slopes
    error = 1 / np.sqrt(left @ inverse @ left)
    assert abs(found - size) < 4 * error
    assert deviations == pytest.approx(found / error, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [DAMPING, 0.0])
def test_damping_that_a_model_lacks_shows_although_little_remains(tmp_path: Path, damping: float) -> None:
    """Friction compensates for nearly all of it, so that the log is not unlikely."""
    log = slide_log(0, damping)
    shoot, _ = slide_shooting(tmp_path, log, FREE[1:], 0.0)
    estimate = shoot._regressed(shoot.cut([log]), np.array([0.4]), np.array([NOISE])).estimate
    assert estimate
    assert estimate.is_likely
    assert estimate.correlations is None
    if damping:
        assert estimate.lack
        assert estimate.lack.path == "add:joint/*.damping"
        assert estimate.lack.value == pytest.approx(DAMPING, rel=0.5)
    else:
        assert estimate.lack is None


def test_what_compensates_for_a_change_is_simulated_within_the_bounds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only negative friction would compensate for damping that stops the box."""
    monkeypatch.setattr("mjrun.fitting.simulated_regression.MOST_ROUNDS", 2)
    log = slide_log(0, 0.0)
    shoot, _ = slide_shooting(tmp_path, log, FREE[1:], 0.0)
    search = search_of(shoot, log, np.array([0.4]), NOISE)
    regressed(shoot, search)
    seen: list[float] = []
    residuals = search._problem.residuals

    def watched(points: Sequence[Unknowns], added: tuple[Override, ...] = ()) -> Simulating[list[list[Floats]]]:
        seen.extend(float(each.coordinates[0]) for each in points)
        return (yield from residuals(points, added))

    monkeypatch.setattr(search._problem, "residuals", watched)
    together(predictor_of(shoot), [search.lack([Override("add:joint/*.damping", "1000")])])
    assert 0 <= min(seen) <= max(seen) <= 1


def test_the_same_seed_gives_the_same_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjrun.fitting.simulated_regression.MOST_ROUNDS", 2)
    solution, _ = solved()
    shoot, _ = shooting(THREE)
    searches = [search_of(shoot, segments(0.5)[0], solution.coordinates, solution.noise[0], seed) for seed in (0, 0, 1)]
    first = regressed(shoot, searches[0])[1].draws
    monkeypatch.setattr("mjrun.fitting.simulated_regression.BATCH_NUMBERS", 1)  # as if the log were long
    second, other = (regressed(shoot, each)[1].draws for each in searches[1:])
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)
    assert first.min() >= 0
    assert first.max() <= 1


def test_each_round_tells_the_nearest_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    """An interrupted fit writes the last one."""
    monkeypatch.setattr("mjrun.fitting.simulated_regression.MOST_ROUNDS", 3)
    solution, _ = solved()
    shoot, _ = shooting(THREE)
    told = list[Solution]()
    regressed(shoot, search_of(shoot, segments(0.5)[0], np.full(3, 0.5), solution.noise[0], advanced=told.append))
    costs = [each.cost for each in told]
    assert len(costs) == 3
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < costs[0]


def test_without_simulations_that_succeed_there_is_no_estimate() -> None:
    solution, _ = solved()
    shoot, _ = shooting(THREE)
    running = search_of(shoot, segments(0.5)[0], solution.coordinates, solution.noise[0]).estimate()

    def failing() -> Generator[Any, Any, Any]:
        """Answers every simulation of the search with a failure."""
        asked = next(running)
        while True:
            asked = running.send([np.full((len(each.chunk.positions), 1), np.nan) for each in asked])
            yield

    with pytest.raises(RuntimeError) as stopped:
        list(failing())
    assert isinstance(stopped.value.__cause__, StopIteration)
    assert stopped.value.__cause__.value[1] is None
