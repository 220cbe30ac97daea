"""Simulations whose results stay in memory: for notebooks, and for programs that need no files.

Each function makes what the command of the same purpose makes, with the same options and the same numbers.
"""

import weakref
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from mjrun.errors import MjrunError
from mjrun.formats.temporary_output import scratch_folder
from mjrun.model.source import ModelSource
from mjrun.model.sources import ModelLike
from mjrun.model.table_column import Column
from mjrun.options.option import options_for
from mjrun.outputs.trace import Trace
from mjrun.plotting.table_figure import Table
from mjrun.python_help import OF_FILES
from mjrun.simulation.simulation import Simulation
from mjrun.task.task import Task

if TYPE_CHECKING:
    from mjrun.evaluation.evaluation import EvaluationResult
    from mjrun.fitting.result import FitResult
    from mjrun.study.study import StudyResult

R = TypeVar("R")
Simulated = ModelLike | Task | Simulation
NO_CONTROLLERS: Mapping[str, Callable[..., object]] = {}


def trace(model: Simulated, **options: object) -> Table:
    """Simulates a model, and returns the table that `mjrun trace` writes, with the same numbers.

    Args:
      model: a model as in `mjrun.Simulation`, or a simulation.
      options: the options of `mjrun.Simulation` and `mjrun.Trace`; with `output`, the table is also written.

    Raises:
      TypeError: an option is unknown.
      MjrunError: as `mjrun.Trace(…).run()` raises.
    """
    described, chosen = options_for("trace", options, Simulation, Trace)
    rows = _Rows()
    simulation = _simulation("trace", model, described)
    Trace(simulation, written="output" in options, rows_to=rows.begin, **chosen).run()
    return rows.table()


def frames(model: Simulated, **options: object) -> Generator[np.ndarray]:
    """Simulates a model, and yields the frames of the video that `mjrun video` makes, with the same pixels.

    The simulation runs when the first frame is asked for, and frames are drawn one after another, in one thread.

    Args:
      model: a model as in `mjrun.Simulation`, or a simulation.
      options: the options of `mjrun.Simulation` and `mjrun.Video`, without those of its file.

    Yields:
      Arrays uint8 `(height, width, 3)`; with `style="exact"`, uint16 `(height, width)`: depths [mm], or ids.

    Raises:
      TypeError: an option is unknown.
      MjrunError: as `mjrun.Video(…).run()` raises.
    """
    from mjrun.outputs.video import VideoInMemory, video_frames

    described, chosen = options_for("frames", options, Simulation, VideoInMemory, without=OF_FILES)
    return video_frames(VideoInMemory(_simulation("frames", model, described), "frames.mkv", **chosen))


def sweep(
    model: Simulated, *, controllers: Mapping[str, Callable[..., object]] = NO_CONTROLLERS, **options: object
) -> "StudyResult":
    """Simulates a model with varied parameters, as `mjrun sweep` does; `result.table` has a row for each point.

    Args:
      model: a model as in `mjrun.Simulation`, or a simulation.
      controllers: functions by the values of `controller`, where the controller varies.
      options: the options of `mjrun.Simulation` and `mjrun.Study`. Without `output`, the files of the study exist as
        long as the result; with it, `mjrun sweep FOLDER` continues the study, unless it has code or a model in memory.

    Raises:
      TypeError: an option is unknown.
      MjrunError: as `mjrun.Study(…).run()` raises.
    """
    from mjrun.document.study import with_document
    from mjrun.study.study import Study

    described, chosen = options_for("sweep", options, Simulation, Study)
    simulation = _simulation("sweep", model, described)
    chosen["controllers"] = controllers
    return _in_folder(chosen, lambda folder: with_document(Study(simulation, folder, **chosen)).run())


def evaluate(task: ModelSource | str, **options: object) -> "EvaluationResult":
    """Plays episodes of a task with a policy, as `mjrun eval` does; `result.table` has a row for each episode.

    Args:
      task: a task, its document, or a name such as `scene:car_drive` or `gym:Walker2d-v5`.
      options: the options of `mjrun.Evaluation`. Without `output`, the files exist as long as the result.

    Raises:
      TypeError: an option is unknown.
      MjrunError: as `mjrun.Evaluation(…).run()` raises.
    """
    from mjrun.document.evaluation import evaluated_task
    from mjrun.evaluation.evaluation import Evaluation

    (chosen,) = options_for("evaluate", options, Evaluation)
    made, rewritten = evaluated_task(task, ()) if isinstance(task, str) else (task, None)
    return _in_folder(chosen, lambda folder: Evaluation(made, folder, rewritten=rewritten, **chosen).run())


def fit(model: Simulated, data: str | Path | Sequence[str | Path], **options: object) -> "FitResult":
    """Estimates parameters of a model from measurements, as `mjrun fit` does.

    Args:
      model: a model as in `mjrun.Simulation`, or a simulation.
      data: one or several tables of measurements.
      options: the options of `mjrun.Simulation` and of `mjrun fit`; `free` selects the parameters, and `output` is the
        file of the fitted model, if there is to be one.

    Raises:
      TypeError: an option is unknown.
      UnidentifiableError: the measurements do not determine the parameters.
      UnimprovedFitError: the fitted model does not predict held-out data better.
      MjrunError: the fit is impossible.
    """
    from mjrun.fitting.fit import Fit

    described, chosen = options_for("fit", options, Simulation, Fit, without=("data",))
    return Fit(_simulation("fit", model, described), data=data, **chosen).run()  # type: ignore[arg-type]


def _simulation(caller: str, model: Simulated, described: Mapping[str, Any]) -> Simulation:
    if not isinstance(model, Simulation):
        return Simulation(model, **described)
    if described:
        raise TypeError(f"{caller}: the simulation has these options: {', '.join(sorted(described))}")
    return model


def _in_folder(chosen: dict[str, Any], run: Callable[[str], R]) -> R:
    """Runs with the folder in `output`, or else with one that is removed with the result."""
    folder = chosen.pop("output", None)
    if folder is not None:
        return run(folder)
    with ExitStack() as stack:
        place = stack.enter_context(scratch_folder()) / "results"
        try:
            result = run(str(place))
        except MjrunError as error:
            for result in error.results[:1]:
                _Files(stack.pop_all()).belong_to(result)
            raise
        _Files(stack.pop_all()).belong_to(result)
    return result


class _Files:
    """The files of a result in memory, removed with the last of its copies; a pickle has none."""

    def __init__(self, folder: ExitStack) -> None:
        weakref.finalize(self, folder.close)

    def belong_to(self, result: object) -> None:
        """Lets `result` and its copies hold the files, although it is frozen."""
        vars(result)["_files"] = self

    def __deepcopy__(self, _: object) -> "_Files":
        return self

    def __reduce__(self) -> tuple[type[None], tuple[()]]:
        return type(None), ()


class _Rows:
    """The rows of a trace, collected block by block."""

    def __init__(self) -> None:
        self._columns: Sequence[Column] = ()
        self._blocks: list[np.ndarray] = []

    def begin(self, columns: Sequence[Column]) -> Callable[[np.ndarray], object]:
        self._columns = columns
        return lambda block: self._blocks.append(block.copy())

    def table(self) -> Table:
        numbers = np.concatenate(self._blocks).T.copy()
        units = {column.name: column.unit for column in self._columns}
        return Table(dict(zip(units, numbers, strict=True)), units)
