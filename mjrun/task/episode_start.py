"""How the episodes of a task start: the model and the state that a seed gives."""

from collections.abc import Sequence
from fnmatch import fnmatchcase

import mujoco
import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean, concerning, option
from mjrun.model import state
from mjrun.model.override import Override
from mjrun.model.source import Source
from mjrun.model.variants import ModelVariant, ModelVariants
from mjrun.physics.distribution import draw_numbers, draw_text
from mjrun.physics.initial_state import InitialState
from mjrun.probe.fields import field_probe
from mjrun.task.measurement import as_slice
from mjrun.task.random_streams import MODEL, START, stream
from mjrun.task.terms import Reset

FIELDS = ("qpos", "qvel", "act", "ctrl")  # what can be drawn of the start
WILD = ("*", "?", "[")


class EpisodeStarts:
    """The states at which episodes start.

    Args:
      reset: what is said of them.
      model: with the names that are used.

    Raises:
      UnknownNameError: a name is not in the model.
      UsageError: a value does not fit.
    """

    def __init__(self, reset: Reset, model: mujoco.MjModel) -> None:
        self._start = InitialState(reset.key, reset.qpos, reset.qvel, reset.ctrl)
        slices = state.fields(state.sizes(model))
        with concerning("reset"):
            set_, noise = _places("set", reset.set, model, slices), _places("noise", reset.noise, model, slices)
        drawn = {int(place) for places, _ in (*set_, *noise) for place in places}
        self._quaternions = [slice(q, q + 4) for q in _quaternions(model, slices) if drawn & {*range(q, q + 4)}]
        self._set, self._noise = (
            [(as_slice(each), len(each), text) for each, text in drawn_] for drawn_ in (set_, noise)
        )
        self._same: tuple[mujoco.MjModel, np.ndarray] | None = None
        self._scratch: tuple[mujoco.MjModel, mujoco.MjData] | None = None

    def state(self, variant: ModelVariant, seed: int) -> np.ndarray:
        """The integration state `(nstate,)` at the start of the episode of `seed` in a model; not to be changed."""
        same = self._unchanged(variant)
        if not (self._set or self._noise):
            return same
        start, generator = same.copy(), stream(seed, START)
        for places, count, text in self._set:
            start[places] = draw_numbers(text, generator, count)
        for places, count, text in self._noise:
            start[places] += draw_numbers(text, generator, count)
        for quaternion in self._quaternions:
            mujoco.mju_normalize4(start[quaternion])
        return start

    def _unchanged(self, variant: ModelVariant) -> np.ndarray:
        """The state before anything is drawn, remembered for the last model that is as it was compiled."""
        if self._same is not None and self._same[0] is variant.model:
            return self._same[1]
        if self._scratch is None or self._scratch[0] is not variant.compiled:  # whose sizes it has
            self._scratch = variant.compiled, mujoco.MjData(variant.compiled)
        data = self._scratch[1]
        with concerning("reset"):
            self._start.reset(variant.model, data)
        start = state.save(variant.model, data)
        if variant.model is variant.compiled:  # others may be written over
            self._same = variant.model, start
        return start


class EpisodeModels:
    """The models of episodes: one for all, or one for each seed.

    Args:
      source: of the model.
      vary: what is drawn of it, by path.
      variants: which loads them.

    Raises:
      UsageError: what varies cannot.
    """

    def __init__(self, source: Source, vary: Sequence[tuple[str, str]], variants: ModelVariants) -> None:
        self._source, self._vary, self._variants = source, vary, variants
        for path, _ in vary:
            if path == "opt.timestep":
                message = f"{option('vary')} {path}: the timestep of a task is the same in all episodes"
                raise UsageError(message, ("reset", "vary", path))

    @property
    def is_one(self) -> bool:
        """Whether all episodes have the same model."""
        return not self._vary

    def model(self, seed: int) -> mujoco.MjModel:
        """The model of the episode of `seed`; see `variant`."""
        return self.variant(seed).model

    def reuse(self, variant: ModelVariant) -> None:
        """Takes the model of an episode that is over: that of another may be written over it."""
        self._variants.reuse(variant)

    def variant(self, seed: int) -> ModelVariant:
        """The model of the episode of `seed`; not to be changed: others may have the same.

        Raises:
          UsageError: a path of what varies names nothing, or a value does not fit.
        """
        if self.is_one:
            return self._variants.load(self._source)
        generator = stream(seed, MODEL)
        overrides = [Override(path, draw_text(text, generator)) for path, text in self._vary]
        try:
            return self._variants.load(self._source.with_overrides(overrides))
        except UsageError as error:
            if error.path[:1] == ("set",):  # as overrides are called otherwise
                error.path = ("reset", "vary", *error.path[1:])
            raise


def _places(
    what: str, texts: Sequence[tuple[str, str]], model: mujoco.MjModel, slices: dict[str, slice]
) -> list[tuple[np.ndarray, str]]:
    """Where in a state the columns that each of `texts` names are, and its text."""
    columns: dict[str, int] = {}
    for field in FIELDS:
        if field in slices:
            start = slices[field].start
            columns |= {column.name: start + i for i, column in enumerate(field_probe(model, field).columns)}
    found = []
    for pattern, text in texts:
        matches = [place for name, place in columns.items() if _is_meant(name, pattern)]
        if not matches:
            with concerning(what, pattern):
                raise UnknownNameError("column", pattern, [*columns], where=f"{option(what)} {clean(pattern)}")
        found.append((np.array(matches), text))
    return found


def _is_meant(column: str, pattern: str) -> bool:
    """Whether `pattern` is the column, its joint or its field, or matches it."""
    if column == pattern or column.startswith(f"{pattern}/"):
        return True
    return any(sign in pattern for sign in WILD) and fnmatchcase(column, pattern)


def _quaternions(model: mujoco.MjModel, slices: dict[str, slice]) -> list[int]:
    """Where in a state the quaternions of joints begin."""
    starts = []
    for address, kind in zip(model.jnt_qposadr.tolist(), map(int, model.jnt_type), strict=True):
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            starts.append(address + 3)
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            starts.append(address)
    return [slices["qpos"].start + start for start in starts]
