"""Parts shared by commands that simulate: the simulation, the cameras, and the making of outputs."""

import os
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from mjrun.cli.click_command import ParsedCommandLine, further_value_hint
from mjrun.cli.console import CommandReport, Console, flag
from mjrun.cli.report_formats import CiVerdict
from mjrun.cli.table_cells import byte_size, numbers, texts
from mjrun.errors import MjrunError, UsageError, clean, counted, option, quoted
from mjrun.options.model import ServoOptions
from mjrun.options.output import LAST_INSTANT, RerunOptions, SimulationCommandOptions
from mjrun.options.policy import ZERO
from mjrun.options.trace import TraceOptions
from mjrun.suffixes import is_yaml

if TYPE_CHECKING:
    from mjrun.diff.result import DiffResult
    from mjrun.model.source import ModelSource
    from mjrun.model.table_column import Column
    from mjrun.outputs.export import ExportResult
    from mjrun.outputs.image import ImageResult
    from mjrun.outputs.keyframe import KeyframeResult
    from mjrun.outputs.output import OutputRequest, OutputResult
    from mjrun.outputs.plot import PlotResult
    from mjrun.outputs.recording import RecordingResult
    from mjrun.outputs.trace import TraceResult
    from mjrun.outputs.up_to_date_check import EarlierReport, UpToDateCheck
    from mjrun.outputs.video import VideoResult
    from mjrun.plotting.table_and_study_plot import TablePlotResult
    from mjrun.probe.verdict import Verdict
    from mjrun.simulation.simulation import Simulation

R = TypeVar("R", bound="OutputResult")
MOST_TEXTS = 3  # units and meanings of a group that are listed
PARTS = (("unit", "unit"), ("of", "kind"), ("meaning", "meaning"))
CONTROLLER = "FILE.py:NAME or PACKAGE.MODULE:NAME names a function (model, data), or a class with __call__ and reset"
LISTED = 10  # changes of a golden table that are shown


def import_mujoco() -> None:
    """Imports MuJoCo in the environment of workers: without an OpenGL backend, and with one thread for linear algebra.

    MuJoCo would choose a backend by MUJOCO_GL, or fail at an unknown name. With one thread, a controller computes the
    same numbers in every command on any number of cores, and the process can still be copied.

    Raises:
      WrongVersionError: MuJoCo or NumPy has a version that mjrun does not support.
    """
    if "mujoco" in sys.modules:
        return
    from mjrun.child_process import ENVIRONMENT

    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    os.environ.update(ENVIRONMENT)
    import_module("mujoco")
    from mjrun.packages import require_core_versions

    for name, value in before.items():
        if value is None:
            del os.environ[name]
        else:
            os.environ[name] = value
    require_core_versions()


def try_backend_early(command_line: ParsedCommandLine) -> None:
    """Tries the first OpenGL backend while this process imports MuJoCo, if a copy of it can do so.

    The first `BackendDetector` takes the trial over, by the environment, which `import_mujoco` restores for that.
    """
    from mjrun.child_process import may_fork
    from mjrun.rendering.backend import start_early

    can_copy = "mujoco" not in sys.modules and may_fork()
    if can_copy and command_line.value("renderer") != "filament" and not command_line.value("if_changed"):
        with suppress(MjrunError):  # which the detection raises again
            start_early(cast("str | None", command_line.value("gl")))


def source(command_line: ParsedCommandLine) -> "ModelSource":
    """Returns the source in the place of the model, which may be the task of a document, with its overrides."""
    from mjrun.model.override import overrides_of

    whole = _source(command_line)
    return replace(whole, overrides=(*whole.overrides, *overrides_of(command_line.make(ServoOptions))))


def stem(command_line: ParsedCommandLine) -> str:
    """Returns the name of the model, or of the document, for default names of outputs."""
    text = command_line.argument("model")
    return Path(text).stem if is_yaml(text) else _source(command_line).stem


def simulation(command_line: ParsedCommandLine) -> "Simulation":
    """Returns the simulation that a command line describes."""
    from mjrun.model.sources import is_task_name
    from mjrun.simulation.simulation import Simulation

    text = command_line.argument("model")
    model = _source(command_line) if is_task_name(text) else text
    return command_line.with_converted("controller", load_controller).make(Simulation, model=model)


def _source(command_line: ParsedCommandLine) -> "ModelSource":
    import_mujoco()
    from mjrun.model.sources import is_task_name, parse_source

    text = command_line.argument("model")
    if not is_task_name(text):
        return parse_source(text)
    from mjrun.document.task import read_task

    return read_task(text)


def load_controller(code: str) -> Callable[..., object]:
    """Loads the controller that `code` names; a class is instantiated.

    Raises:
      UsageError: `code` does not have that form, or its target does not exist.
      FileError: the file does not exist.
      ControllerError: its code failed.
    """
    from mjrun.python_code import RedirectedFunction, load_code, made

    controller = made(load_code(code, "controller", CONTROLLER), code, "controller")
    if not callable(controller):
        kind = type(controller).__name__
        raise UsageError(f"{option('controller')} {quoted(code)} is of type {kind} and cannot be called\n{CONTROLLER}")
    return RedirectedFunction(controller)


def varied_controllers(command_line: ParsedCommandLine) -> dict[str, Callable[..., object]]:
    """Loads the controllers among the values of parameters, by what names them."""
    from mjrun.experiment.design import value_list
    from mjrun.options.sweep import VariationOptions

    varied = [text for path, text in command_line.make(VariationOptions).vary if path == "controller"]
    return {name: load_controller(name) for text in varied for name in value_list("controller", text, "vary")}


def with_camera_scripts(command_line: ParsedCommandLine) -> ParsedCommandLine:
    """Reads the camera scripts on a command line."""
    return command_line.with_converted("camera", _camera)


def _camera(spec: str) -> object:
    if not is_yaml(spec):
        return spec
    from mjrun.document.camera_and_ghost_forms import read_camera

    return read_camera(spec)


def make_outputs(
    console: Console,
    command_line: ParsedCommandLine,
    request: "OutputRequest[R]",
    time: Fraction | None = None,
    step: int | None = None,
    report: "Callable[[R], CommandReport] | None" = None,
) -> "R":
    """Makes the requested output, and a recording and a keyframe if asked for; or prints a document for all.

    Args:
      time, step: time of the keyframe; by default, the last instant.
      report: makes the report of the result.
    """
    from mjrun.outputs.perform import perform

    options = command_line.make(SimulationCommandOptions)
    requests: list[OutputRequest[OutputResult]] = [request]
    if options.recording is not None:
        from mjrun.outputs.recording import Recording

        partial = command_line.make(TraceOptions, simulation=None).keep_partial
        requests.append(Recording(request.simulation, options.recording, keep_partial=partial, command=console.command))
    if options.save_key is not None:
        from mjrun.outputs.keyframe import Keyframe

        path, suffix, name = options.save_key.rpartition(".xml:")
        path, name = (f"{path}.xml", name) if suffix else (options.save_key, LAST_INSTANT)
        requests.append(Keyframe(request.simulation, path, name=name, time=time, step=step, command=console.command))
    if options.print_document:
        from mjrun.document.run_writer import document_text

        console.result(document_text(requests, console.command).rstrip("\n"))
        raise click.exceptions.Exit(0)

    try:
        if options.if_changed or options.depfile:
            return cast("R", _make_if_changed(console, requests, options, report or _report))
        return cast("R", perform(requests, console)[0])
    except MjrunError as error:
        if console.document_form and error.results:
            console.answer(_report(error.results[0]))
        raise


def _make_if_changed(
    console: Console,
    requests: "Sequence[OutputRequest[OutputResult]]",
    options: RerunOptions,
    report: Callable[[Any], CommandReport],
) -> "OutputResult":
    """Makes outputs unless they are up to date, which ends the command."""
    from mjrun.outputs.perform import PublishedOutput, perform
    from mjrun.outputs.up_to_date_check import UpToDateCheck

    with UpToDateCheck(requests, options) as last:
        if earlier := last.up_to_date():
            console.answer(unchanged(earlier))
            raise click.exceptions.Exit(0)
        tell_reason(console, last)
        published = list[PublishedOutput]()
        result = perform(requests, console, published)[0]
        warn_of_repetition(console, last.finish(published, report(result).json))
    return result


def unchanged(earlier: "EarlierReport") -> CommandReport:
    """Returns the report of a run that is not repeated."""
    return CommandReport(
        "",
        earlier,
        summary=lambda: earlier.sentence,
        cases=lambda: [CiVerdict(**case) for case in earlier.cases],
        document=lambda _: {**earlier.document},
    )


def tell_reason(console: Console, last: "UpToDateCheck") -> None:
    """Tells why outputs are made again."""
    if last.reason:
        console.note(f"made again: {last.reason}")


def warn_of_repetition(console: Console, reason: str) -> None:
    """Warns that the next run makes the outputs again, if there is a reason."""
    if reason:
        console.warn(f"{reason}: the next run makes the outputs again")


def show(console: Console, command_line: ParsedCommandLine, result: "OutputResult", default_output: str = "") -> None:
    """Prints the result as JSON, or as a line, on standard output unless that carries the payload."""
    console.answer(_report(result), is_piped=payload_on_stdout(command_line, default_output))


def _report(result: "OutputResult") -> CommandReport:
    kind = type(result).__name__.removesuffix("Result").lower()
    return CommandReport(kind, result, summary=lambda: summary(result))


def payload_on_stdout(command_line: ParsedCommandLine, default_output: str = "") -> bool:
    """Returns whether standard output carries the output.

    Raises:
      UsageError: a document is requested on standard output too.
    """
    piped = (command_line.value("output") or default_output) == "-"
    if piped and (form := command_line.document_form):
        raise UsageError(f"{option(form)} and the output both print to standard output; give {option('output')} FILE")
    return piped


def is_study(path: str) -> bool:
    """Returns whether a path is a study document, rather than a task, which replaces a model."""
    if not is_yaml(path):
        return False
    from mjrun.document.task import is_task

    return not is_task(path)


def refuse_assignments(model: str, assignments: Sequence[str]) -> None:
    """Raises UsageError for KEY=VALUE after a model that is not a document."""
    if assignments:
        is_assignment = "=" in assignments[0]
        fault = f"{clean(model)} is not a document, so KEY=VALUE cannot change it"
        hint = further_value_hint(assignments[0], click.get_current_context())
        raise UsageError(f"{clean(assignments[0])}: {fault if is_assignment else 'unexpected argument'}{hint}")


@contextmanager
def reported_failures(
    console: Console,
    report: Callable[[Sequence[Any]], CommandReport],
    in_prose: type[MjrunError] = MjrunError,
    form: str = "",
) -> Generator[None, None, None]:
    """Prints the report of the results that were made in spite of an error.

    Args:
      report: makes the report from the results in the error.
      in_prose: errors whose results are also reported in prose; documents report them for all errors.
      form: the option that requests another form.
    """
    try:
        yield
    except MjrunError as error:
        if error.results and (console.document_form or isinstance(error, in_prose)):
            console.answer(report(error.results), form)
        raise


def show_columns(
    console: Console,
    source: "ModelSource",
    probes: Sequence[str] = (),
    policy: object = None,
    *,
    groups: bool = False,
) -> None:
    """Lists the columns of a trace, or those of `probes`, one per line or as one document.

    The columns of a task do not depend on the policy.

    Args:
      groups: list their groups only, unless a document is requested.
    """
    from mjrun.outputs.trace import columns
    from mjrun.simulation.simulation import Simulation
    from mjrun.task.task import Task

    listed = columns(Simulation(source, policy=ZERO if isinstance(source, Task) else policy), probes)
    if console.document_form:
        console.document({"columns": [asdict(column) for column in listed]})
        return
    if groups:
        _show_groups(console, listed)
        return
    width = max(len(clean(column.name)) for column in listed)
    for column in listed:
        owner = f"{column.kind} {column.id}" if column.kind else ""
        console.result(f"{clean(column.name):{width}}  {column.unit:8}  {owner:12}  {column.meaning}".rstrip())


def _show_groups(console: Console, columns: "Sequence[Column]") -> None:
    from mjrun.cli.terminal_layout import TerminalReport
    from mjrun.probe.select import column_groups

    groups = column_groups(columns)
    page = TerminalReport()
    shown = [
        texts("probe", [group.name for group in groups]),
        numbers("columns", [len(group.columns) for group in groups]),
        *(texts(heading, [", ".join(group.texts(name)[:MOST_TEXTS]) for group in groups]) for heading, name in PARTS),
    ]
    page.table("groups of columns", shown, len(groups))
    page.note(f"{flag('list')} {flag('all')} lists every column, {flag('list')} {flag('probe')} NAME those of a group")
    console.result(page.text())


def _video(result: "VideoResult") -> str:
    width, height = result.size
    frames = counted(result.frames, "frame")
    shown = f"{width}x{height}, {frames}, {result.duration:.4g} s at {_figure(result.fps, 4)} fps, {result.codec}"
    pace = f"made in {result.wall:.1f} s, {_figure(result.frames / result.draw_wall, 3)} frames/s"
    by = f"by {clean(result.renderer)} ({result.gl})" + (f" in {result.jobs} processes" if result.jobs > 1 else "")
    return f"{', '.join(map(clean, result.paths))}: {shown}; {pace}, {by}"


def _figure(value: float, digits: int) -> str:
    """Formats a number with three significant digits, or all before the point: 0.125, 29.97, 10000."""
    return f"{value:.{digits}g}" if value < 10 ** (digits - 1) else f"{value:.0f}"


def _image(result: "ImageResult") -> str:
    width, height = result.size
    paths = ", ".join(map(clean, result.paths)) or "-"
    return f"{paths}: {width}x{height} at {result.time:.6g} s; made in {result.wall:.1f} s, by {clean(result.renderer)}"


def _trace(result: "TraceResult") -> str:
    size = f"{counted(result.rows, 'row')}, {counted(result.columns, 'column')}"
    pace = f"{result.simulated:.6g} s in {counted(result.steps, 'step')}; made in {result.wall:.2f} s"
    golden = f"\n{golden_summary(result.golden)}" if result.golden else ""
    path = f"{clean(result.path)}: " if result.path else ""
    return "\n".join([f"{path}{size}, {pace}{golden}", *_assertions(result.assertions)])


def _assertions(verdicts: Sequence["Verdict"]) -> list[str]:
    """Yields a line per assertion that holds; failed assertions are errors."""
    return [f"  assertion passed: {verdict.message}" for verdict in verdicts if verdict.passed]


def golden_summary(result: "DiffResult") -> str:
    """Formats a line about a golden table, with the changes if it was replaced."""
    from mjrun.diff.sentences import golden_versions

    assert result.golden
    path, count, versions = clean(result.a), len(result.differences), golden_versions(result.golden)
    if not result.golden.updated:
        return f"{path}: {'agrees' if result.equal else 'differs'}; {versions}"
    if result.table is None and result.equal:
        return f"{path}: made"
    changes = [f"  {sentence}" for sentence in result.differences[:LISTED]]
    more = [f"  … and {count - LISTED} more"] if count > LISTED else []
    changed = "" if count else ", and nothing changed"
    return "\n".join([f"{path}: updated; {versions}{changed}", *changes, *more])


def _plot(result: "PlotResult") -> str:
    width, height = result.size
    return f"{clean(result.path)}: {width}x{height}, {result.samples} samples"


def _table_plot(result: "TablePlotResult") -> str:
    width, height = result.size
    curves = f"{counted(result.curves, 'curve')} in " if result.curves else ""  # heat maps have none
    size = f"{width}x{height}, {curves}{counted(len(result.panels), 'panel')}"
    paths: list[str] = [result.path, *([result.html] if result.html else [])]
    made = f"{', '.join(map(clean, dict.fromkeys(paths)))}: {size}, {counted(sum(result.rows), 'row')}"
    return "\n".join([made, *_assertions(result.assertions)])


def _recording(result: "RecordingResult") -> str:
    return f"{clean(result.path)}: {result.states} states of {result.size} numbers, {result.simulated:.6g} s"


def _keyframe(result: "KeyframeResult") -> str:
    return f"{clean(result.path)}: keyframe {clean(result.name)} of step {result.step}, {result.time:.6g} s"


def _export(result: "ExportResult") -> str:
    frames = counted(result.frames, "frame")
    length = f"{frames}, {result.duration:.4g} s at {_figure(result.fps, 4)} fps"
    size = f", {byte_size(result.size)}" if result.size else ""
    return f"{clean(result.path)}: {result.format}, {length}{size}; made in {result.wall:.1f} s"


SUMMARIES: "dict[str, Callable[[Any], str]]" = {
    "VideoResult": _video,
    "ImageResult": _image,
    "TraceResult": _trace,
    "PlotResult": _plot,
    "TablePlotResult": _table_plot,
    "RecordingResult": _recording,
    "KeyframeResult": _keyframe,
    "ExportResult": _export,
}


def summary(result: "OutputResult | TablePlotResult") -> str:
    """Formats the summary of a result of any kind."""
    return SUMMARIES[type(result).__name__](result)
