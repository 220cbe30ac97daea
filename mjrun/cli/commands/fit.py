"""Estimate parameters of a model from measurements."""

from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import ON_FILES, ModelArgument, ParsedCommandLine, command
from mjrun.cli.console import CommandReport, Console
from mjrun.cli.simulation_command import import_mujoco, simulation
from mjrun.cli.table_cells import ReportColumn, number, span
from mjrun.errors import UsageError, clean, option
from mjrun.options.every_command import opened_file
from mjrun.options.fit import FitOptions
from mjrun.options.option import options_of
from mjrun.options.simulation import SimulationOptions
from mjrun.suffixes import is_yaml

if TYPE_CHECKING:
    from mjrun.fitting.excitation import ExcitationResult
    from mjrun.fitting.fit import Fit
    from mjrun.fitting.result import FitResult

CORRELATED = 0.95  # of parameters that are listed
SHOWN = 40  # rows of a table
ARGUMENTS = (
    ModelArgument("model", metavar="MODEL|FIT.yaml"),
    click.Argument(["tables"], nargs=-1, type=click.Path(readable=False), metavar="DATA...|[KEY=VALUE]..."),
)


@command(
    FitOptions,
    SimulationOptions,
    *ON_FILES,
    arguments=ARGUMENTS,
    reports={"fit": "mjrun.fitting.result:FitResult", "excite": "mjrun.fitting.excitation:ExcitationResult"},
)
def fit(console: Console, command_line: ParsedCommandLine) -> None:
    """Estimate parameters of MODEL from measurements: DATA are tables with columns such as time, qpos/knee and
    ctrl/motor.

    \b
    mjrun fit arm.xml log.csv --free 'joint/elbow.damping=log:0.01..10' -o fitted.xml
    mjrun fit arm.xml log.csv --free 'scale:joint/*.armature=0.2..5' --map 'qpos/elbow=elbow_deg*pi/180' --json
    mjrun fit arm.xml log.csv --free delay:ctrl/motor=0..0.05 --comparison fit.csv
    mjrun plot fit.csv --y 'qpos/*' -o fit.png
    mjrun fit arm_fit.yaml starts=8 -o fitted.xml
    mjrun fit arm.xml --free 'joint/*.damping=0.1..10' --excite chirp.csv && mjrun video arm.xml --ctrl-from chirp.csv

    FIT.yaml is a fit document; KEY=VALUE changes a value in it.

    The last fifth of the measurements is held out. Exits with 1 if the fitted model does not predict it better than
    MODEL, or if the measurements do not determine the parameters.
    """
    import_mujoco()
    from mjrun.fitting.excitation import excite

    def show(result: "FitResult") -> None:
        console.answer(CommandReport("fit", result, summary=lambda: fit_report(result)))

    job, located = _fit(command_line)
    command_line.require(opened_file("video", "output", "comparison", "excite"), job)
    console.page = job.html
    with located:
        if job.excite is None:
            show(job.run(console, show))
        else:
            motion = excite(job, console)
            console.answer(CommandReport("excite", motion, summary=lambda: excitation_report(motion)))


def _fit(command_line: ParsedCommandLine) -> "tuple[Fit, AbstractContextManager[None]]":
    """Returns the fit of a command line or of its document, and the context that locates its errors."""
    from mjrun.fitting.fit import Fit

    model, data = command_line.argument("model"), command_line.arguments("tables")
    if not is_yaml(model):
        from mjrun.model.sources import is_model_name

        if not is_model_name(model) and (models := [*filter(is_model_name, data)]):
            files = clean(" ".join([models[0], model]))
            raise UsageError(f"{clean(model)} is not a model; the model precedes the tables: mjrun fit {files}")
        if not data and command_line.value("excite") is None:
            raise click.UsageError("Missing argument 'DATA...'.", click.get_current_context())
        return command_line.make(Fit, simulation=simulation(command_line), data=data), nullcontext()
    from mjrun.document.fit import read_fit

    for each in options_of(SimulationOptions):
        if each.attribute in command_line.explicit(SimulationOptions):
            raise UsageError(f"{option(each.name)} cannot accompany {clean(model)}; write {each.key}=VALUE instead")
    request = read_fit(model, data, values=command_line.explicit(FitOptions))
    return request.made, request.located()


def fit_report(result: "FitResult") -> str:
    """Formats the parameters with their intervals, the prediction errors of the signals, and the files written."""
    from mjrun.cli.terminal_layout import TerminalReport

    page = TerminalReport()
    if result.partial:
        page.note("partial: the fit was interrupted, and these are the best parameters so far")
    page.table("parameters", _parameters(result), len(result.parameters), SHOWN)
    if result.inertias:
        page.table("inertias", _inertias(result), sum(len(each.quantities) for each in result.inertias), SHOWN)
    page.table("errors", _signals(result), len(result.signals), SHOWN)
    if result.loss != "linear":
        page.note(f"errors and noise by medians, as the loss is {result.loss}: outliers are no part of them")
    if alike := _correlated(result):
        page.lines("correlated", alike)
    if result.changes:
        page.verbatim("changed", result.changes)
    for file in result.files:
        page.note(clean(file))
    segments = f"{result.segments} segment{'' if result.segments == 1 else 's'}"
    page.note(f"reduced χ² {number(result.reduced_chi2)}: residuals over the noise of the log, squared")
    if result.ways:
        page.note(f"fitted: {', then '.join(result.ways)}")
    page.note(f"{result.rows:,} rows in {segments} fitted; {result.rollouts:,} rollouts; {result.wall:.1f} s")
    return page.text()


def excitation_report(result: "ExcitationResult") -> str:
    """Formats the expected intervals, the range of motion of the model, and the files written."""
    from mjrun.cli.terminal_layout import TerminalReport

    page = TerminalReport()
    parameters, motion = result.parameters, result.motion
    columns = [
        ReportColumn("parameter", [clean(each.label) for each in parameters]),
        ReportColumn("if it is", [number(each.start) for each in parameters], right=True),
        ReportColumn(
            f"expected {100 * result.confidence:g} % interval",
            [span((each.low, each.high)) for each in parameters],
        ),
    ]
    page.table("parameters", columns, len(parameters), SHOWN)
    columns = [
        ReportColumn("motion", [clean(each.name) for each in motion]),
        ReportColumn("from", [number(each.low) for each in motion], right=True),
        ReportColumn("to", [number(each.high) for each in motion], right=True),
        ReportColumn("", [each.unit for each in motion]),
        ReportColumn(
            "limits",
            ["" if each.least is None or each.most is None else span((each.least, each.most)) for each in motion],
        ),
    ]
    page.table("motion", columns, len(motion), SHOWN)
    for file in result.files:
        page.note(clean(file))
    page.note(
        f"{result.duration:g} s; the best of {result.candidates} inputs within limits, where they also are at "
        f"{result.corners} corners of the bounds; positions with a noise of {number(result.noise)}; {result.wall:.1f} s"
    )
    return page.text()


def _parameters(result: "FitResult") -> list[ReportColumn]:
    parameters = result.parameters
    share = f"{100 * result.confidence:g} % interval"
    return [
        ReportColumn("parameter", [clean(each.label) for each in parameters]),
        ReportColumn("before", [number(each.start) for each in parameters], right=True),
        ReportColumn("fitted", [number(each.value) for each in parameters], right=True),
        ReportColumn(share, [span((each.low, each.high)) for each in parameters]),
        ReportColumn("", [f"at its {each.bound} bound" if each.bound else "" for each in parameters]),
    ]


def _inertias(result: "FitResult") -> list[ReportColumn]:
    rows = [(each.body, quantity) for each in result.inertias for quantity in each.quantities]
    quantities = [quantity for _, quantity in rows]
    return [
        ReportColumn("body", [clean(body) for body, _ in rows]),
        ReportColumn("", [each.name for each in quantities]),
        ReportColumn("before", [number(each.start) for each in quantities], right=True),
        ReportColumn("fitted", [number(each.value) for each in quantities], right=True),
        ReportColumn("", [each.unit for each in quantities]),
        ReportColumn(
            f"{100 * result.confidence:g} % interval",
            [span((each.low, each.high)) if each.low < each.high else "" for each in quantities],
        ),
    ]


def _signals(result: "FitResult") -> list[ReportColumn]:
    signals = result.signals
    columns = [
        ReportColumn("signal", [clean(each.name) for each in signals]),
        ReportColumn("residual", [f"{number(each.noise)} {each.unit}".strip() for each in signals], right=True),
        ReportColumn("over noise", [number(each.misfit) for each in signals], right=True),
        ReportColumn("before", [_share(each.nominal) for each in signals], right=True),
        ReportColumn("fitted", [_share(each.fitted) for each in signals], right=True),
    ]
    if any(each.holdout_fitted is not None for each in signals):
        columns += [
            ReportColumn("held out, before", [_share(each.holdout_nominal) for each in signals], right=True),
            ReportColumn("fitted", [_share(each.holdout_fitted) for each in signals], right=True),
        ]
    return columns


def _correlated(result: "FitResult") -> list[tuple[str, str]]:
    pairs: list[tuple[str, str]] = []
    for i, one in enumerate(result.parameters):
        for j, other in enumerate(result.parameters[:i]):
            if abs(result.correlation[i][j]) > CORRELATED:
                pairs.append((f"{result.correlation[i][j]:.3f}", f"{clean(other.path)}, {clean(one.path)}"))
    return pairs


def _share(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.3g} %"
