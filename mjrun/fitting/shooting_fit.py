"""Shooting: joint least squares of parameters and the initial states of stretches of a log.

The result explains whole segments, each from one fitted state. They are tried first. If their residuals stay above the
noise of the log, the search continues from other starts and over short stretches, each from its own state (H. G. Bock,
"Recent advances in parameter identification techniques for O.D.E.", 1983), which become longer and begin in the states
of the shorter ones. Contacts can make the sum of squares rough, so that derivatives mislead: ensembles continue from
the end, over openings of segments that become longer.
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
    CovarianceFactors,
    EnsembleSearch,
    GaussNewton,
)
from mjrun.fitting.measurements import LEAST_NOISE, LogSegment, shared
from mjrun.fitting.prediction import Chunk, ChunkInitialStates, Predictor, chunks
from mjrun.fitting.shooting_problem import (
    Advanced,
    Floats,
    Result,
    ShootingProblem,
    Simulating,
    Solution,
    together,
    with_noise,
)
from mjrun.fitting.starting_states import StateGuesses, simulated_starts

SHORTEST = 24  # rows of the shortest stretches
GROWTH = 2
FINE = 1e-4  # reduced χ² below which derivatives have found the motion exactly
CONTACT_EVALUATIONS = 24  # limit of evaluations from which ensembles continue beside contacts
OTHERS = 2  # other starts of whole segments before stretches are tried
MODEST = 100.0  # reduced χ² below which other starts are tried, and searches that end alike confirm each other
ALIKE = 0.01  # relative difference of the costs of two searches that end alike
WEIGHTINGS = 4  # most searches with other weights of signals
SHOTS = 3  # number of searches by ensembles
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
        return chunks(segments, rows, self._predictor.timestep, self._predictor.lead)

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
        return self._smoothed(solution, coordinates, noise, fixed=True)

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
        least = LEAST_NOISE * shared(np.nanstd(values, axis=0), groups)
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
        if self._is_stopped(first):
            search.ways.append("whole segments, smoothed by ensembles across contacts")
            search.best = self._smoothed(first, first.coordinates, noise, advanced=advanced)

        if search.best.reduced >= EXPLAINED:
            self._continue(search, segments, starts, noise, advanced)
        if self._predictor.has_impacts and search.best.reduced > FINE:
            level = noise * max(1.0, search.best.reduced**0.5)
            tasks = [self._rough(whole, search.best.coordinates, level, seed=seed) for seed in range(SHOTS)]
            best = with_noise(min(together(self._predictor, tasks), key=lambda each: each.cost), noise)
            if best.reduced < EXPLAINED * search.best.reduced:
                search.ways.append("ensembles of nearby states, as contacts make the motion rough")
                search.best = best
        if search.best.cost <= own.cost:
            return search
        if search.best.variances:  # no simulation is nearer to the log than that of the original model
            search.best = replace(search.best, coordinates=starts[0], states=own.states, residuals=own.residuals)
        else:  # from the states that fit the original model best
            better = self.solve(whole, starts[0], own.states, noise)
            search.best = min([search.best, better], key=lambda each: each.cost)
        return search

    def _is_stopped(self, solution: Solution) -> bool:
        """Returns whether jumps of the motion at contacts may have ended a search."""
        return self._predictor.has_impacts and solution.reduced >= EXPLAINED

    def _smoothed(
        self,
        solution: Solution,
        coordinates: Floats | None,
        noise: Floats,
        *,
        fixed: bool = False,
        advanced: Advanced | None = None,
    ) -> Solution:
        """Continues searches that jumps of the motion have ended, while this halves the cost.

        Ensembles that take all residuals for noise are wide enough to cross jumps; derivatives continue from there.

        Args:
          coordinates: coordinates of the solution; None for the original model.
          fixed: whether the parameters are constant.
        """
        parts, is_gain, seed = solution.chunks, True, 0
        while is_gain and self._is_stopped(solution):
            level = noise * solution.reduced**0.5
            wide = with_noise(self._run(self._rough(parts, coordinates, level, fixed=fixed, seed=seed)), noise)
            place = None if coordinates is None else wide.coordinates
            search = GaussNewton(self._problem(parts, place, wide.states, noise, fixed=fixed), advanced)
            tolerance = ROUGH_TOLERANCE if fixed else TOLERANCE
            narrow = self._run(search.minimize(CONTACT_EVALUATIONS, tolerance))
            best = min([wide, narrow], key=lambda each: each.cost)
            is_gain, seed = best.cost < 0.5 * solution.cost, seed + 1
            if best.cost < solution.cost:
                solution, coordinates = best, None if coordinates is None else best.coordinates
        return solution

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
            openings = [_opening(part) for part in parts]
            opening = GaussNewton(self._problem(openings, coordinates, states, noise, fixed=True))
            states = (yield from opening.approach()).states
        tolerance = ROUGH_TOLERANCE if fixed else TOLERANCE
        search = GaussNewton(self._problem(parts, coordinates, states, noise, fixed=fixed), advanced)
        evaluations = CONTACT_EVALUATIONS if self._predictor.has_impacts else EVALUATIONS
        return (yield from search.minimize(evaluations, tolerance))

    def _rough(
        self,
        parts: Sequence[Chunk],
        coordinates: Floats | None,
        noise: Floats,
        *,
        fixed: bool = False,
        seed: int = 0,
    ) -> Simulating[Solution]:
        """Solves openings of chunks of increasing length by ensembles, each from the end of the one before."""
        states, rows = self.guessed(parts, coordinates), SHORTEST
        scatter: CovarianceFactors | None = None
        while True:
            openings = [_opening(part, rows) for part in parts]
            is_last = all(a.rows == b.rows for a, b in zip(openings, parts, strict=True))
            problem = self._problem(openings, coordinates, states, noise, fixed=fixed)
            search = EnsembleSearch(problem, self._seed + seed, scatter)
            end: tuple[Solution, CovarianceFactors] = yield from search.minimize(is_last=is_last)
            solution, scatter = end
            if is_last:
                return solution
            states, coordinates = solution.states, None if coordinates is None else solution.coordinates
            rows *= 2

    def _problem(
        self,
        parts: Sequence[Chunk],
        coordinates: Floats | None,
        states: Floats,
        noise: Floats,
        *,
        fixed: bool = False,
    ) -> ShootingProblem:
        setting = (self._predictor, self._parameters, self._states)
        return ShootingProblem(*setting, parts, coordinates, states, noise, self._loss, fixed)

    def _run(self, task: Simulating[Result]) -> Result:
        (result,) = together(self._predictor, [task])
        return result


def _begin(chunk: Chunk) -> tuple[int, int]:
    return id(chunk.segment), chunk.first_step


def _opening(chunk: Chunk, rows: int = SHORTEST) -> Chunk:
    """Returns the first rows of a chunk; all if few more follow."""
    if len(chunk.positions) < 1.5 * rows:
        return chunk
    return replace(chunk, rows=slice(chunk.rows.start, chunk.rows.start + rows), positions=chunk.positions[:rows])
