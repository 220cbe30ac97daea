"""Multiple shooting: parameters and the states in which chunks begin, found together by least squares.

Chunks are short at first, where every rollout is almost linear in what is looked for, and grow to whole segments,
which tell most of slow effects. H. G. Bock, "Recent advances in parameter identification techniques for O.D.E."
(1983), is the source of shooting from several states.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mjrun.fit.free_parameter import FreeParameter
from mjrun.fit.measurements import Segment
from mjrun.fit.noise import LEAST_NOISE
from mjrun.fit.prediction import Chunk, Predictor, States, chunks
from mjrun.fit.rotations import shared
from mjrun.fit.shooting_problem import ShootingProblem
from mjrun.fit.solution import Floats, Solution, with_noise
from mjrun.fit.starting_states import StartingStates
from mjrun.fit.unmeasured_states import simulated_starts

EVALUATIONS = 40  # of one stage, at most
FEW_EVALUATIONS = 12  # of each of several starts
SHORTEST = 24  # rows of the first chunks
GROWTH = 2
TOLERANCE = 1e-8  # relative change of the cost at which the last stage ends
ROUGH_TOLERANCE = 1e-5  # the same of stages that others follow, and where the states alone are looked for
EXPLAINED = 5.0  # cost of a solution, in standard deviations of the noise, with which no other is looked for
SHOTS = 5  # from one start, at most
WORTHWHILE = 0.95  # of the cost before, if another shot may follow
DENSE = 40  # unknowns up to which a Jacobian is factored as a whole

Advanced = Callable[[Solution], None]


class Shooting:
    """Fits parameters to segments.

    Args:
      loss: of scipy's `least_squares`: `linear`, or one that outliers weigh less in.
    """

    def __init__(
        self, predictor: Predictor, parameters: Sequence[FreeParameter], starting: StartingStates, loss: str = "linear"
    ) -> None:
        self._predictor, self._parameters, self._starting, self._loss = predictor, parameters, starting, loss
        self._states = States(predictor.model)

    def cut(self, segments: Sequence[Segment], rows: int) -> list[Chunk]:
        """The chunks of about `rows` rows."""
        return chunks(segments, rows, self._predictor.timestep, self._predictor.lead)

    def guessed(self, parts: Sequence[Chunk], coordinates: Floats | None) -> Floats:
        """States to begin with, from what was measured, and else from the model.

        Args:
          coordinates: of the parameters; None for the model as it was.
        """
        if not self._starting.all_measured:
            values = None if coordinates is None else self._values(coordinates)
            return simulated_starts(self._predictor, self._starting, parts, values)
        return np.stack([self._starting.guess(part, self._predictor.timestep) for part in parts])

    def solve(
        self,
        parts: Sequence[Chunk],
        coordinates: Floats,
        states: Floats,
        noise: Floats,
        *,
        evaluations: int = EVALUATIONS,
        tolerance: float = TOLERANCE,
        advanced: Advanced | None = None,
    ) -> Solution:
        """Minimizes the residuals of `parts`.

        Args:
          coordinates, states: where to begin.
          noise: standard deviation of each signal.
          evaluations: of the residuals, at most.
          tolerance: relative change of the cost at which it ends.
          advanced: is told of every solution that is better than the one before.
        """
        return self._solved(parts, coordinates, states, noise, evaluations, tolerance, advanced=advanced)

    def follow(self, parts: Sequence[Chunk], coordinates: Floats | None, states: Floats, noise: Floats) -> Solution:
        """The states alone that minimize the residuals of `parts`, the parameters being as they are.

        Args:
          coordinates: of the parameters; None for the model as it was.
        """
        return self._solved(parts, coordinates, states, noise, EVALUATIONS, ROUGH_TOLERANCE, fixed=True)

    def _solved(
        self,
        parts: Sequence[Chunk],
        coordinates: Floats | None,
        states: Floats,
        noise: Floats,
        evaluations: int,
        tolerance: float,
        *,
        fixed: bool = False,
        advanced: Advanced | None = None,
    ) -> Solution:
        from scipy.optimize import least_squares

        problem = self._problem(parts, coordinates, states, noise, fixed=fixed)
        low, high = problem.bounds
        dense = len(low) <= DENSE

        def jacobian(x: Floats):
            slopes = problem.jacobian(x)  # which is asked for wherever residuals have become less
            if advanced:
                advanced(replace(problem.solution(x), loss=self._loss))
            return slopes.toarray() if dense else slopes

        result = least_squares(
            problem.residuals,
            problem.start,
            jacobian,  # pyright: ignore[reportArgumentType]  (its types know of names alone)
            bounds=(low, high),
            method="trf",
            x_scale=1.0 if fixed else "jac",  # by slopes, the first steps from no deviation would be tiny
            loss=self._loss,
            tr_solver="exact" if dense else "lsmr",
            max_nfev=evaluations,
            xtol=1e-7,
            ftol=tolerance,
        )
        return replace(problem.solution(np.asarray(result.x, float)), loss=self._loss)

    def look(self, parts: Sequence[Chunk], coordinates: Floats, states: Floats, noise: Floats) -> Solution:
        """Residuals and sensitivities at a start, where nothing is minimized."""
        problem = self._problem(parts, coordinates, states, noise)
        return problem.solution(problem.start)

    def best_start(
        self, segments: Sequence[Segment], starts: Sequence[Floats], noise: Floats, advanced: Advanced | None = None
    ) -> Floats:
        """Where the shortest chunks lead from several starts: the coordinates with the least residuals.

        Args:
          advanced: is told of every solution that is better than the one before of the same start.
        """
        parts = self.cut(segments, SHORTEST)
        solutions = [
            self.solve(
                parts,
                start,
                self.guessed(parts, start),
                noise,
                evaluations=FEW_EVALUATIONS,
                tolerance=ROUGH_TOLERANCE,
                advanced=advanced,
            )
            for start in starts
        ]
        return min(solutions, key=lambda solution: solution.cost).coordinates

    def stages(self, segments: Sequence[Segment]) -> list[list[Chunk]]:
        """The chunks of the stages of a fit: longer and longer ones, to whole segments."""
        rows, cuts = SHORTEST, [self.cut(segments, SHORTEST)]
        while len(cuts[-1]) > len(segments):
            rows *= GROWTH
            cuts.append(self.cut(segments, rows))
        return cuts

    def grown(
        self, segments: Sequence[Segment], start: Floats, noise: Floats, advanced: Advanced | None = None
    ) -> list[Solution]:
        """Solutions with longer and longer chunks, to whole segments; each stage begins at the one before.

        Args:
          advanced: is told of every solution that is better than the one before.
        """
        solutions: list[Solution] = []
        coordinates, stages = start, self.stages(segments)
        for parts in stages:
            states = self._taken_over(parts, solutions[-1]) if solutions else self.guessed(parts, start)
            tolerance = TOLERANCE if parts is stages[-1] else ROUGH_TOLERANCE
            solution = self.solve(parts, coordinates, states, noise, tolerance=tolerance, advanced=advanced)
            noise = self._noise(solution)
            solutions.append(solution)
            coordinates = solution.coordinates
        return solutions

    def searched(
        self, found: Solution, starts: Sequence[Floats], noise: Floats, advanced: Advanced | None = None
    ) -> list[Solution]:
        """Further solutions of the chunks of `found`, the best one last; none if `found` is good or none is better.

        Short chunks say little of a state that is not measured, and may lead to a wrong basin. Whole segments that are
        shot from several starts may lead to another.

        Args:
          found: of whole segments.
          starts: coordinates, tried in turn until one explains the measurements.
          noise: by which solutions are compared.
          advanced: is told of every solution that is better than all before.
        """
        tried: list[Solution] = []
        best = with_noise(found, noise)
        for start in () if self._starting.all_measured else starts:
            if best.cost < EXPLAINED:
                break
            shots = self._shots(found.chunks, start, noise)
            tried += shots
            if shots[-1].cost < best.cost:
                best = shots[-1]
                if advanced:
                    advanced(best)
        if best not in tried:
            return []
        return [*(each for each in tried if each is not best), best]

    def _problem(
        self, parts: Sequence[Chunk], coordinates: Floats | None, states: Floats, noise: Floats, *, fixed: bool = False
    ) -> ShootingProblem:
        setting = (self._predictor, self._parameters, self._states)
        return ShootingProblem(*setting, parts, coordinates, states, noise, fixed)

    def _shots(self, parts: Sequence[Chunk], start: Floats, noise: Floats) -> list[Solution]:
        """Solutions from a start, the best one last, each from where the one before ended.

        The states are guessed anew: those of a fit that is far from the truth have been bent to make up for it.
        """
        shots: list[Solution] = []
        coordinates = start
        for _ in range(SHOTS):
            shot = self.solve(parts, coordinates, self.guessed(parts, coordinates), noise)
            if shots and shot.cost > WORTHWHILE * shots[-1].cost:
                return sorted([*shots, shot], key=lambda solution: -solution.cost)
            shots.append(shot)
            coordinates = shot.coordinates
        return shots

    def _noise(self, solution: Solution) -> Floats:
        """The noise that the residuals show."""
        values = np.concatenate([part.values for part in solution.chunks])
        groups = self._predictor.rotations
        return np.maximum(shared(solution.noise_scale, groups), LEAST_NOISE * shared(np.nanstd(values, axis=0), groups))

    def _taken_over(self, parts: Sequence[Chunk], before: Solution) -> Floats:
        """States for `parts` from chunks that began at the same step; guesses elsewhere."""
        known = {(id(c.segment), c.first_step): s for c, s in zip(before.chunks, before.states, strict=True)}
        guesses = self.guessed(parts, before.coordinates)
        return np.stack([known.get((id(p.segment), p.first_step), g) for p, g in zip(parts, guesses, strict=True)])

    def _values(self, coordinates: Floats) -> tuple[float, ...]:
        return tuple(each.value(c) for each, c in zip(self._parameters, coordinates, strict=True))
