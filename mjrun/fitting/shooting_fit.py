"""Shooting: joint least squares of parameters and the initial states of stretches of a log.

The result explains whole segments, each from one fitted state. They are tried first. If their residuals stay above the
noise of the log, the search continues from other starts and over short stretches, each from its own state (H. G. Bock,
"Recent advances in parameter identification techniques for O.D.E.", 1983), which become longer and begin in the states
of the shorter ones. Contacts can make the sum of squares rough, so that derivatives mislead: there, regression on
simulated logs finds the parameters and their errors.
"""

from collections.abc import Sequence
from dataclasses import field, replace

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.fitting.free_parameter import FreeParameter, values_at
from mjrun.fitting.gauss_newton import (
    EVALUATIONS,
    EXPLAINED,
    ROUGH_TOLERANCE,
    TOLERANCE,
    GaussNewton,
    is_rough,
)
from mjrun.fitting.information import all_information, scattered
from mjrun.fitting.measurements import LogSegment, least_noise, shared
from mjrun.fitting.prediction import Chunk, ChunkInitialStates, Predictor, chunks
from mjrun.fitting.shooting_problem import (
    Advanced,
    Floats,
    Result,
    RoughMotionEstimate,
    ShootingProblem,
    Simulating,
    Solution,
    together,
)
from mjrun.fitting.simulated_regression import RegressionSearch
from mjrun.fitting.starting_states import WINDOW, StateGuesses, simulated_starts
from mjrun.model.override import Override

SHORTEST = 24  # rows of the shortest stretches
FEWER = (6, 12)  # rows of shorter openings, solved one after the other
GROWTH = 2
FEW = 4 * SHORTEST  # rows of openings below which parameters are constant
FINE = 1e-4  # reduced χ² below which derivatives have found the motion exactly
CONTACT_EVALUATIONS = 24  # limit of evaluations beside contacts
STEPS = "steps from each measured state to the next"
MOST_PAIRS = 400  # about the number of rows from which measured states are followed to the next row
OTHERS = 2  # other starts of whole segments before stretches are tried
MODEST = 100.0  # reduced χ² below which other starts are tried, and searches that end alike confirm each other
ALIKE = 0.01  # relative difference of the costs of two searches that end alike
WEIGHTINGS = 4  # most searches with other weights of signals
NEAR = 1.0  # largest distance of a solution from the estimate by regression, in standard errors
SMALL = 0.1  # share of the kinetic energy that a change of the model costs on trial
WHOLE = 10**9  # rows


@dataclass
class OriginalAndBestSolutions:
    """The solutions by the original model and by the best parameters, as a search found them.

    Attributes:
      own: solution of whole segments by the original model, from the states that fit best.
      best: solution of whole segments by the best parameters.
      ways: methods that were tried, in words.
    """

    own: Solution
    best: Solution
    ways: list[str] = field(default_factory=list[str])


class ShootingFit:
    """A fit of parameters to segments.

    Args:
      loss: loss function of scipy's `least_squares`; all but `linear` reduce the weight of outliers.
      seed: seed of random points in searches of rough sums of squares.
    """

    def __init__(
        self,
        predictor: Predictor,
        parameters: Sequence[FreeParameter],
        starting: StateGuesses,
        loss: str = "linear",
        seed: int = 0,
    ) -> None:
        self._predictor, self._parameters, self._starting = predictor, parameters, starting
        self._loss, self._seed = loss, seed
        self._states = ChunkInitialStates(predictor.model)

    def cut(self, segments: Sequence[LogSegment], rows: int = WHOLE) -> list[Chunk]:
        """Cuts segments into chunks of about `rows` rows."""
        parts = chunks(segments, rows, self._predictor.timestep, self._predictor.lead)
        return [part if part.rows.start else self._begun(part) for part in parts]

    def _begun(self, part: Chunk) -> Chunk:
        """Returns the chunk at the beginning of a segment, without its first row if only the second shows its state.

        That is so if positions alone are measured: velocities are known from the second row on.
        """
        rows, positions = slice(part.rows.start + 1, part.rows.stop), part.positions[1:] - 1
        second = replace(part, rows=rows, first_step=part.first_step + 1, positions=positions)
        return second if self._sampled([part]) is None and self._sampled([second]) is not None else part

    def guessed(self, parts: Sequence[Chunk], coordinates: Floats | None, before: Solution | None = None) -> Floats:
        """Guesses initial states from measurements and, for what is not measured, from the model.

        Args:
          coordinates: coordinates of the parameters; None for the original model.
          before: solution of shorter stretches, whose states replace guesses for the same initial rows.
        """
        if self._starting.all_measured:
            states = np.stack([self._starting.guess(part, self._predictor.timestep) for part in parts])
        else:
            values = None if coordinates is None else values_at(self._parameters, coordinates)
            states = simulated_starts(self._predictor, self._starting, parts, values)
        solved = {_begin(part): s for part, s in zip(before.chunks, before.states, strict=True)} if before else {}
        return np.stack([solved.get(_begin(part), guess) for part, guess in zip(parts, states, strict=True)])

    def look(self, parts: Sequence[Chunk], coordinates: Floats, states: Floats, noise: Floats) -> Solution:
        """Returns residuals and sensitivities at a start, without a search."""
        return replace(self._run(GaussNewton(self._problem(parts, coordinates, states, noise)).look()), loss="linear")

    def solve(self, parts: Sequence[Chunk], coordinates: Floats, states: Floats, noise: Floats) -> Solution:
        """Minimizes the residuals of `parts` from a start."""
        return self._run(GaussNewton(self._problem(parts, coordinates, states, noise)).minimize())

    def follow(self, parts: Sequence[Chunk], coordinates: Floats | None, noise: Floats) -> Solution:
        """Minimizes the residuals of `parts` over the states, with constant parameters.

        Args:
          coordinates: coordinates of the parameters; None for the original model.
        """
        solution = self._run(self._grown(parts, coordinates, noise, fixed=True))
        if solution.reduced >= EXPLAINED and (states := self._sampled(parts)) is not None:
            problem = self._problem(parts, coordinates, states, noise, fixed=True)
            other = self._run(GaussNewton(problem).minimize(CONTACT_EVALUATIONS, ROUGH_TOLERANCE))
            solution = min([solution, other], key=lambda each: each.cost)
        if not self._is_stopped(solution):
            return solution
        return min([solution, self._regressed(parts, coordinates, noise, fixed=True)], key=lambda each: each.cost)

    def compared(self, parts: Sequence[Chunk], coordinates: Floats, noise: Floats) -> list[Solution]:
        """Follows `parts` with the original model and with other parameters.

        Each continues from the states of the other where contacts have stopped it, so that both have equal chances.
        """
        places = (None, coordinates)
        ends = [self.follow(parts, place, noise) for place in places]
        for i in range(2):
            if self._is_stopped(ends[i]):
                problem = self._problem(parts, places[i], ends[1 - i].states, noise, fixed=True)
                again = self._run(GaussNewton(problem).minimize(CONTACT_EVALUATIONS, ROUGH_TOLERANCE))
                ends[i] = min([ends[i], again], key=lambda each: each.cost)
        return ends

    def weighted(self, solution: Solution) -> Solution:
        """Minimizes again from `solution`, with signals weighted by its residuals, until these are as large as assumed.

        A signal whose noise was overestimated has had too little weight, so that others have pulled the solution.
        """
        groups = self._predictor.rotations
        values = np.concatenate([part.values for part in solution.chunks])
        least = np.minimum(least_noise(values, groups), solution.noise)
        for _ in range(WEIGHTINGS):
            noise = np.maximum(shared(solution.noise_scale, groups), least)
            if np.abs(np.log(noise / solution.noise)).max() < np.log(EXPLAINED):
                break
            solution = self.solve(solution.chunks, solution.coordinates, solution.states, noise)
        return solution

    def search(
        self, segments: Sequence[LogSegment], starts: Sequence[Floats], noise: Floats, advanced: Advanced | None = None
    ) -> OriginalAndBestSolutions:
        """Searches for the best parameters for whole segments.

        Args:
          starts: initial coordinates, those of the original model first.
          advanced: called with every solution that is better than all before.
        """
        whole = self.cut(segments)
        own = self._run(self._grown(whole, None, noise, fixed=True))
        first = self._run(self._grown(whole, starts[0], noise, advanced=advanced))
        search = OriginalAndBestSolutions(own, first, ["whole segments"])
        if first.reduced > FINE and not 1 / EXPLAINED < first.reduced < EXPLAINED:  # the noise is not as assumed
            self._follow_states(search, segments, starts[0], noise)
        if self._is_stopped(search.best) and not _is_likely(search.best):
            self._regress(search, noise, advanced)
        if search.best.reduced >= EXPLAINED and not _is_likely(search.best):
            self._continue(search, segments, starts, noise, advanced)
        if self._predictor.has_impacts:
            if not self._is_rough(search.best):
                search.best = replace(search.best, estimate=None)
            elif not _is_likely(search.best):
                self._regress(search, noise, advanced)
        if search.best.cost <= search.own.cost:
            return search
        if search.best.estimate:  # no simulation is nearer to the log than that of the original model
            search.best = replace(
                search.best, coordinates=starts[0], states=search.own.states, residuals=search.own.residuals
            )
        else:  # from the states that fit the original model best
            better = self.solve(whole, starts[0], search.own.states, noise)
            search.best = min([search.best, better], key=lambda each: each.cost)
        return search

    def _follow_states(
        self, search: OriginalAndBestSolutions, segments: Sequence[LogSegment], start: Floats, noise: Floats
    ) -> None:
        """Continues a search from the parameters by which each measured state best follows from the one before.

        Between neighbouring states, motions at contacts do not jump. Noise of the states biases these parameters, so
        they replace others only where whole segments fit better with them: in logs with little noise.
        """
        most = MOST_PAIRS // len(segments) + 1
        pairs = [pair for segment in segments for pair in self._pairs(segment, most)]
        known = [(pair, state) for pair in pairs if (state := self._sampled([pair])) is not None]
        whole, first = search.best.chunks, self._sampled(search.best.chunks)
        if first is None or len(known) < SHORTEST:
            return
        parts, states = zip(*known, strict=True)
        problem = self._problem(parts, start, np.concatenate(states), noise, fixed_states=True)
        end = self._run(GaussNewton(problem).minimize())
        look = replace(self.look(whole, end.coordinates, first, noise), loss=self._loss)
        of_states, tolerances = self._starting.of_states, self._starting.step_tolerances(self._predictor.timestep)
        left = np.concatenate(list(end.residuals))[:, of_states] * noise[of_states]
        least = least_noise(np.concatenate([part.values for part in whole]), self._predictor.rotations) * tolerances
        is_exact = bool((np.sqrt(np.nanmean(left**2, axis=0)) <= least[of_states]).all())
        if is_exact and self._is_stopped(look):  # rounding alone has made whole segments jump
            search.ways.append(STEPS)
            own = self._problem(whole, None, first, noise, fixed=True)
            search.own = self._run(GaussNewton(own).look())
            known, generator = all_information(end, self._parameters), np.random.default_rng(self._seed)
            draws = np.clip(end.coordinates + scattered(end, known, generator), 0, 1)
            search.best = replace(look, estimate=RoughMotionEstimate(draws, probability=1.0))
            return
        solution = self._lengthened(whole, end.coordinates, first, noise)
        if solution is None and look.cost < search.best.cost:
            solution = self.solve(whole, end.coordinates, first, noise)
        if solution and solution.cost < search.best.cost:
            search.ways.append(STEPS)
            search.best = solution

    def _lengthened(
        self, whole: Sequence[Chunk], coordinates: Floats, states: Floats, noise: Floats
    ) -> Solution | None:
        """Solves openings that double in length up to `whole`, each from the end of the one before.

        Velocities that are differences of rounded positions are off by this rounding over a timestep, which leads a
        long motion beside contacts far from the log; each opening makes them more exact.

        Returns:
          The solution of `whole`; None if the model does not explain it, or an opening.
        """
        longest, rows = max(len(part.positions) for part in whole), SHORTEST
        while True:
            parts, is_whole = [_opening(part, rows) for part in whole], 1.5 * rows > longest
            problem = self._problem(parts, coordinates, states, noise, fixed=rows < FEW and not is_whole)
            limits = (EVALUATIONS, TOLERANCE) if is_whole else (CONTACT_EVALUATIONS, ROUGH_TOLERANCE)
            end = self._run(GaussNewton(problem).minimize(*limits))
            if end.reduced >= EXPLAINED:
                return None
            if is_whole:
                return end
            coordinates, states, rows = end.coordinates, end.states, GROWTH * rows

    def _pairs(self, segment: LogSegment, most: int) -> list[Chunk]:
        """Returns chunks of two rows, at most twice `most`, without signals of force, which jump even between these."""
        shown, of_states = np.full_like(segment.values, np.nan), self._starting.of_states
        shown[:, of_states] = segment.values[:, of_states]
        segment = replace(segment, values=shown)
        steps = segment.steps(self._predictor.timestep)
        firsts = np.round(steps).astype(int).tolist()
        count = len(steps) - 1
        rows = range(0, count, max(count // most, 1))
        return [Chunk(segment, slice(i, i + 2), firsts[i], steps[i : i + 2] - firsts[i]) for i in rows]

    def _sampled(self, parts: Sequence[Chunk]) -> Floats | None:
        """Returns the states that the first rows of chunks show, `(chunks, nstate)`; None if one shows none."""
        states = [self._starting.sampled(part, self._predictor.timestep) for part in parts]
        known = [each for each in states if each is not None]
        return np.stack(known) if len(known) == len(parts) else None

    def _is_stopped(self, solution: Solution) -> bool:
        """Returns whether jumps of the motion at contacts may have ended a search."""
        return self._predictor.has_impacts and solution.reduced >= EXPLAINED

    def _is_rough(self, solution: Solution) -> bool:
        """Returns whether derivatives do not show the errors of a solution beside contacts."""
        if not FINE < solution.reduced < EXPLAINED:
            return solution.reduced >= EXPLAINED
        problem = self._problem(solution.chunks, solution.coordinates, solution.states, solution.noise)
        return self._run(is_rough(problem, solution.sensitivities))

    def _regress(self, search: OriginalAndBestSolutions, noise: Floats, advanced: Advanced | None) -> None:
        """Continues a search by regression on simulated logs, and keeps the nearest solution that this permits."""
        search.ways.append("regression on simulated logs, as contacts make the motion rough")
        end = self._regressed(search.best.chunks, search.best.coordinates, noise, advanced=advanced)
        if not (estimate := end.estimate):
            return
        middle, errors = estimate.draws.mean(axis=0), estimate.draws.std(axis=0)
        is_near = (np.abs(search.best.coordinates - middle) <= NEAR * errors).all()
        best = search.best if search.best.cost < end.cost and (is_near or not _is_likely(end)) else end
        search.best = replace(best, estimate=estimate)
        if advanced:
            advanced(search.best)

    def _regressed(
        self,
        parts: Sequence[Chunk],
        coordinates: Floats | None,
        noise: Floats,
        *,
        fixed: bool = False,
        advanced: Advanced | None = None,
    ) -> Solution:
        """Solves chunks by regression on simulated logs, then by derivatives as far as the estimate permits.

        Args:
          coordinates: coordinates around which simulations are drawn; None for the original model.
          fixed: whether the parameters are constant.
        """
        openings = [_opening(part, WINDOW) for part in parts]
        states = self.guessed(parts, coordinates)
        opening, problem = (self._problem(each, coordinates, states, noise, fixed=fixed) for each in (openings, parts))
        search = RegressionSearch(problem, opening, self._seed, advanced)
        end = self._ended(search, problem, coordinates is None)
        correlated, lack = search.correlated_noise, end.estimate.lack if end.estimate else None
        if correlated and correlated.explains_more(lack):
            search = RegressionSearch(problem, opening, self._seed, advanced, noise=correlated)
            other = self._ended(search, problem, coordinates is None)
            if other.estimate and other.estimate.correlations is not None:
                return other
        return end

    def _ended(self, search: RegressionSearch, problem: ShootingProblem, is_nominal: bool) -> Solution:
        """Returns the end of a regression, from which derivatives have led as far as the estimate permits."""
        nearest, estimate = self._run(search.estimate())
        place = None if is_nominal else nearest.coordinates
        fixed = not problem.free
        problem = self._problem(problem.parts, place, problem.states(nearest), problem.noise, fixed=fixed)
        end = self._run(GaussNewton(problem).minimize(CONTACT_EVALUATIONS, ROUGH_TOLERANCE))
        if estimate and problem.free:
            errors = estimate.draws.std(axis=0)
            if (np.abs(end.coordinates - nearest.coordinates) > NEAR * errors).any():
                end = self._run(GaussNewton(problem).look())
            estimate = replace(estimate, lack=self._run(search.lack(self._changes(end))))
        return replace(end, estimate=estimate)

    def _changes(self, solution: Solution) -> list[Override]:
        """Returns changes of all joints that cost or add a small share of the kinetic energy of a solution.

        Models often lack them. Those of which a parameter is free are left out.
        """
        values = values_at(self._parameters, solution.coordinates)
        speeds = np.concatenate(self._predictor.field("qvel", solution.chunks, values, solution.states))
        seconds = self._predictor.timestep * float(np.mean([chunk.steps for chunk in solution.chunks]))
        squares = (speeds**2).sum(axis=1)
        energy = SMALL * float((speeds**2 @ self._predictor.model.dof_M0).max()) / 2
        costs = {
            "damping": seconds * float(squares.mean()),
            "frictionloss": seconds * float(np.abs(speeds).sum(axis=1).mean()),
            "armature": float(squares.max()) / 2,
        }
        free = {each.path.rpartition(".")[2] for each in self._parameters}
        return [
            Override(f"add:joint/*.{field}", repr(energy / cost))
            for field, cost in costs.items()
            if field not in free and cost > 0
        ]

    def _continue(
        self,
        search: OriginalAndBestSolutions,
        segments: Sequence[LogSegment],
        starts: Sequence[Floats],
        noise: Floats,
        advanced: Advanced | None,
    ) -> None:
        """Tries other starts and stretches until the log is explained or two searches end alike."""
        whole = self.cut(segments)

        def is_end(solutions: Sequence[Solution]) -> bool:
            """Keeps the best solution; returns whether the search is complete."""
            is_same = False
            for each in solutions:
                is_same |= abs(each.cost - search.best.cost) < ALIKE * each.cost
                if each.cost < search.best.cost:
                    search.best = each
                    if advanced:
                        advanced(each)
            is_same &= search.best.reduced < MODEST
            return is_same or search.best.reduced < EXPLAINED

        # Far from the noise, stretches succeed sooner.
        for start in starts[1 : 1 + OTHERS] if search.best.reduced < MODEST else ():
            search.ways.append("whole segments from another start")
            if is_end([self._run(self._grown(whole, start, noise))]):
                return
        for group in (starts[:1], starts[1:]):
            places: list[Floats] = list(group)
            before: list[Solution | None] = [None] * len(group)
            for rows, parts in self.stages(segments) if places else []:
                search.ways.append(f"stretches of {rows} rows")
                guesses = [self.guessed(parts, *each) for each in zip(places, before, strict=True)]
                problems = [self._problem(parts, *each, noise) for each in zip(places, guesses, strict=True)]
                ends: list[Solution] = together(self._predictor, [GaussNewton(each).approach() for each in problems])
                places, before = [each.coordinates for each in ends], [*ends]
                tasks = [self._grown(whole, each.coordinates, noise, before=each) for each in ends]
                if is_end(together(self._predictor, tasks)):
                    return

    def stages(self, segments: Sequence[LogSegment]) -> list[tuple[int, list[Chunk]]]:
        """Returns stretches of increasing length, shorter than whole segments: the number of rows, and the chunks."""
        rows, cuts = SHORTEST, list[tuple[int, list[Chunk]]]()
        while len(parts := self.cut(segments, rows)) > len(segments):
            cuts.append((rows, parts))
            rows *= GROWTH
        return cuts

    def _grown(
        self,
        parts: Sequence[Chunk],
        coordinates: Floats | None,
        noise: Floats,
        *,
        fixed: bool = False,
        before: Solution | None = None,
        advanced: Advanced | None = None,
    ) -> Simulating[Solution]:
        """Solves whole chunks from states that fit their first rows.

        Args:
          fixed: whether the parameters are constant.
          before: solution of stretches, whose states replace those of the first rows.
        """
        states = self.guessed(parts, coordinates, before)
        if before is None:
            states = yield from self._approached([_opening(part) for part in parts], coordinates, states, noise)
        tolerance = ROUGH_TOLERANCE if fixed else TOLERANCE
        search = GaussNewton(self._problem(parts, coordinates, states, noise, fixed=fixed), advanced)
        evaluations = CONTACT_EVALUATIONS if self._predictor.has_impacts else EVALUATIONS
        return (yield from search.minimize(evaluations, tolerance))

    def _approached(
        self, openings: Sequence[Chunk], coordinates: Floats | None, states: Floats, noise: Floats
    ) -> Simulating[Floats]:
        """Returns states that fit the first rows of chunks, `(chunks, nstate)`, with constant parameters.

        In fast motion, a search from states that are far off may stop there; then fewer rows show where to begin.
        """

        def approached(parts: Sequence[Chunk], states: Floats) -> Simulating[Solution]:
            return GaussNewton(self._problem(parts, coordinates, states, noise, fixed=True)).approach()

        end = yield from approached(openings, states)
        if end.reduced < EXPLAINED:
            return end.states
        for rows in FEWER:
            states = (yield from approached([_opening(part, rows) for part in openings], states)).states
        other = yield from approached(openings, states)
        return min([end, other], key=lambda each: each.cost).states

    def _problem(
        self,
        parts: Sequence[Chunk],
        coordinates: Floats | None,
        states: Floats,
        noise: Floats,
        *,
        fixed: bool = False,
        fixed_states: bool = False,
    ) -> ShootingProblem:
        setting = (self._predictor, self._parameters, self._states)
        return ShootingProblem(*setting, parts, coordinates, states, noise, self._loss, fixed, fixed_states)

    def _run(self, task: Simulating[Result]) -> Result:
        (result,) = together(self._predictor, [task])
        return result


def _is_likely(solution: Solution) -> bool:
    """Returns whether regression on simulated logs has found the log to be like them."""
    return solution.estimate is not None and solution.estimate.is_likely


def _begin(chunk: Chunk) -> tuple[int, int]:
    return id(chunk.segment), chunk.first_step


def _opening(chunk: Chunk, rows: int = SHORTEST) -> Chunk:
    """Returns the first rows of a chunk; all if few more follow."""
    if len(chunk.positions) < 1.5 * rows:
        return chunk
    return replace(chunk, rows=slice(chunk.rows.start, chunk.rows.start + rows), positions=chunk.positions[:rows])
