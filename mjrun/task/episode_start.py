"""The start of an episode: the model and the initial state that its seed determines."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from fnmatch import fnmatchcase

import mujoco
import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean, concerning, option
from mjrun.model import state
from mjrun.model.override import Override, elements_at
from mjrun.model.source import ModelSource, is_delay
from mjrun.model.variants import ModelVariant, VariantLoader
from mjrun.physics.initial_state import InitialState
from mjrun.physics.kinematic_samples import quaternions
from mjrun.physics.random_distribution import draw_numbers, draw_text, highest_texts
from mjrun.probe.fields import field_probe
from mjrun.task.batch_columns import as_slice
from mjrun.task.random_streams import MODEL, START, stream
from mjrun.task.task import Reset

FIELDS = ("qpos", "qvel", "act", "ctrl")  # fields of the initial state that can be random
Draw = tuple[slice | np.ndarray, int, str]  # places in a state, their number, and the distribution of the values there


class EpisodeStarts:
    """The initial states of episodes.

    Args:
      reset: their description.
      model: the model in which its names are looked up.

    Raises:
      UnknownNameError: a name is not in the model.
      UsageError: a value does not fit.
    """

    def __init__(self, reset: Reset, model: mujoco.MjModel) -> None:
        self._start = InitialState(reset.key, reset.qpos, reset.qvel, reset.ctrl)
        slices = state.fields(state.sizes(model))
        with concerning("reset"):
            values, noise = _places("set", reset.set, model, slices), _places("noise", reset.noise, model, slices)
        drawn = {int(place) for places, _ in (*values, *noise) for place in places}
        starts = [slices["qpos"].start + start for start in quaternions(model, "qpos")]
        self._quaternions = [slice(start, start + 4) for start in starts if drawn & {*range(start, start + 4)}]
        self._values, self._noise = _draws(values), _draws(noise)
        self._unchanged: tuple[mujoco.MjModel, np.ndarray] | None = None
        self._scratch: tuple[mujoco.MjModel, mujoco.MjData] | None = None

    def state(self, variant: ModelVariant, seed: int) -> np.ndarray:
        """Returns the initial state `(nstate,)` of the episode of `seed` in a model; it must not be changed."""
        fixed = self._fixed(variant)
        if not (self._values or self._noise):
            return fixed
        start, generator = fixed.copy(), stream(seed, START)
        for places, count, text in self._values:
            start[places] = draw_numbers(text, generator, count)
        for places, count, text in self._noise:
            start[places] += draw_numbers(text, generator, count)
        for quaternion in self._quaternions:
            mujoco.mju_normalize4(start[quaternion])
        return start

    def _fixed(self, variant: ModelVariant) -> np.ndarray:
        """Returns the state without its random parts; remembers it for the last model that is as compiled."""
        if self._unchanged is not None and self._unchanged[0] is variant.model:
            return self._unchanged[1]
        if self._scratch is None or self._scratch[0] is not variant.compiled:
            self._scratch = variant.compiled, mujoco.MjData(variant.compiled)
        data = self._scratch[1]
        with concerning("reset"):
            self._start.reset(variant.model, data)
        start = state.save(variant.model, data)
        if variant.model is variant.compiled:  # any other model may be overwritten by a later variant
            self._unchanged = variant.model, start
        return start


class EpisodeModels:
    """The models of episodes: one for all, or one for each seed.

    Args:
      source: the source of the model.
      vary: distributions by the path of what they vary.
      variants: loads the models.

    Raises:
      UsageError: a path cannot vary.
      ModelError: the model cannot be loaded, which is loaded here only where delays vary.
    """

    def __init__(self, source: ModelSource, vary: Sequence[tuple[str, str]], variants: VariantLoader) -> None:
        for path, _ in vary:
            if path == "opt.timestep":
                message = f"{option('vary')} {path}: the timestep of a task is the same in all episodes"
                raise UsageError(message, ("reset", "vary", path))
        with _varied():
            self._source = source.with_overrides(_buffers(source, vary))
        self._vary, self._variants = vary, variants

    @property
    def is_one(self) -> bool:
        """True where all episodes have the same model."""
        return not self._vary

    def model(self, seed: int) -> mujoco.MjModel:
        """Returns the model of the episode of `seed`; see `variant`."""
        return self.variant(seed).model

    def reuse(self, variant: ModelVariant) -> None:
        """Releases the model of a finished episode, so that a later one may overwrite it."""
        self._variants.reuse(variant)

    def variant(self, seed: int) -> ModelVariant:
        """Returns the model of the episode of `seed`; it may be shared and must not be changed.

        Raises:
          UsageError: a varied path does not exist, or a value does not fit.
        """
        if self.is_one:
            return self._variants.load(self._source)
        generator = stream(seed, MODEL)
        overrides = [Override(path, draw_text(text, generator)) for path, text in self._vary]
        with _varied():
            return self._variants.load(self._source.with_overrides(overrides))

    def layout_error(self) -> UsageError:
        """Returns the error for models of episodes that a world cannot step one after the other."""
        paths = [path for path, _ in self._vary]
        message = f"{option('vary')} {', '.join(map(clean, paths))}: all episodes must have states of the same size"
        advice = "numbers can vary, but not objects, their kinds, buffers, memory and sleep: use several tasks"
        return UsageError(f"{message}\n{advice}", ("reset", "vary", *(paths if len(paths) == 1 else [])))


@contextmanager
def _varied() -> Generator[None]:
    """Reports errors of overrides within the `with` block at the values that vary."""
    try:
        yield
    except UsageError as error:
        if error.path[:1] == ("set",):  # the option of overrides elsewhere
            error.path = ("reset", "vary", *error.path[1:])
        raise


def _buffers(source: ModelSource, vary: Sequence[tuple[str, str]]) -> list[Override]:
    """Returns overrides that give every episode the buffers of the longest delays, for states of the same size.

    Raises:
      UsageError: a delay has no limit, or a path does not exist.
    """
    longest = {path: highest_texts(text) for path, text in vary if is_delay(Override(path, text))}
    samples = dict[str, int]()
    for path, values in longest.items():
        if not values:
            message = f"{option('vary')} {clean(path)}: a delay must have a limit, as uniform and truncnormal have"
            raise UsageError(message, ("reset", "vary", path))
    for turn in range(max(map(len, longest.values()), default=0)):
        overrides = [Override(path, values[min(turn, len(values) - 1)]) for path, values in longest.items()]
        spec, _ = source.with_overrides(overrides).compile()
        for override in overrides if spec else ():
            buffer = f"{override.target.removesuffix('delay')}nsample"
            needed = [element.nsample for element in elements_at(spec, override)[0]]
            samples[buffer] = max(samples.get(buffer, 0), *needed)
    return [Override(path, str(count)) for path, count in samples.items()]


def _draws(found: Sequence[tuple[np.ndarray, str]]) -> list[Draw]:
    """Joins draws from the same distribution for places side by side: one call draws the same numbers in less time."""
    joined: list[tuple[np.ndarray, str]] = []
    for places, text in found:
        if joined and joined[-1][1] == text:
            both = np.concatenate([joined[-1][0], places])
            if isinstance(as_slice(both), slice):
                joined[-1] = both, text
                continue
        joined.append((places, text))
    return [(as_slice(places), len(places), text) for places, text in joined]


def _places(
    what: str, texts: Sequence[tuple[str, str]], model: mujoco.MjModel, slices: dict[str, slice]
) -> list[tuple[np.ndarray, str]]:
    """Returns the places in a state that each of `texts` names, with its distribution."""
    columns: dict[str, int] = {}
    for field in FIELDS:
        if field in slices:
            start = slices[field].start
            columns |= {column.name: start + i for i, column in enumerate(field_probe(model, field).columns)}
    places: list[tuple[np.ndarray, str]] = []
    for pattern, text in texts:
        matches = [place for name, place in columns.items() if _matches(name, pattern)]
        if not matches:
            with concerning(what, pattern):
                raise UnknownNameError("column", pattern, [*columns], where=f"{option(what)} {clean(pattern)}")
        places.append((np.array(matches), text))
    return places


def _matches(column: str, pattern: str) -> bool:
    """Returns whether `pattern` names the column, its joint or its field, or matches it by wildcards."""
    if column == pattern or column.startswith(f"{pattern}/"):
        return True
    return any(sign in pattern for sign in ("*", "?", "[")) and fnmatchcase(column, pattern)
