"""Make all outputs of a run document in one pass."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjrun.cli.click_command import ON_FILES, ModelArgument, ParsedCommandLine, command
from mjrun.cli.console import CommandReport, Console
from mjrun.cli.report_formats import CiVerdict
from mjrun.cli.simulation_command import (
    import_mujoco,
    load_controller,
    reported_failures,
    summary,
    tell_reason,
    unchanged,
    warn_of_repetition,
)
from mjrun.errors import UsageError, clean, option
from mjrun.options.report import REPORT_FORMATS, ReportFormatOptions
from mjrun.options.run import RunCommandOptions
from mjrun.suffixes import is_yaml

if TYPE_CHECKING:
    from mjrun.document.run import LoadedRunDocument
    from mjrun.outputs.perform import PassPreview, PublishedOutput

ARGUMENTS = (
    ModelArgument("document", type=click.Path(readable=False)),
    click.Argument(["assignments"], metavar="[KEY=VALUE]...", nargs=-1),
)


@command(
    RunCommandOptions,
    ReportFormatOptions,
    *ON_FILES,
    arguments=ARGUMENTS,
    reports={"run-report": "mjrun.outputs.run_report:RunResult"},
)
def run(console: Console, command_line: ParsedCommandLine) -> None:
    """Make all outputs of the run document DOCUMENT in one pass: videos, images, traces and plots of one simulation.

    \b
    mjrun run study.yaml
    mjrun run study.yaml duration=2 'videos[0].size=640x360' -o out
    mjrun run study.yaml --html study.html
    mjrun run study.yaml --dry-run
    """
    form = command_line.form(*REPORT_FORMATS)
    import_mujoco()
    from mjrun.document.run import read_run
    from mjrun.model.sources import is_model_name
    from mjrun.outputs.perform import perform, preview
    from mjrun.outputs.up_to_date_check import UpToDateCheck

    options = command_line.with_converted("controller", load_controller).make(RunCommandOptions)
    document, assignments = command_line.argument("document"), command_line.arguments("assignments")
    if not is_yaml(document) and is_model_name(document):
        advice = f"`mjrun video {clean(document)}` makes a video of it, and with {option('print_document')} a document"
        raise UsageError(f"{clean(document)} is a model, not a document\n{advice}")
    request = read_run(document, assignments, options, console.command)
    with request.located():
        if options.dry_run:
            plan = preview(request.outputs, console)
            console.answer(CommandReport("", plan, lambda: "\n".join(_plan_lines(plan))))
            return

        console.page = request.page.html
        with UpToDateCheck(request.outputs, options, request.documents, request.page.html) as last:
            if earlier := last.up_to_date():
                console.answer(unchanged(earlier), form)
                return
            tell_reason(console, last)
            with (
                reported_failures(console, _report, form=form),
                _page(request, Path(document).name) as published,
            ):
                results = perform(request.outputs, console, published)
            report = _report(results)
            warn_of_repetition(console, last.finish(published, report.json, report.cases))
    console.answer(report, form)


def _page(request: "LoadedRunDocument", title: str) -> "AbstractContextManager[list[PublishedOutput]]":
    """Returns a context that makes the page about the outputs in its list, if one is requested.

    The plotting library is imported only then.
    """
    if request.page.html is None:
        return nullcontext([])
    from mjrun.outputs.run_report import run_page

    return run_page(request.page, title, request.outputs)


def _report(results: Sequence[Any]) -> CommandReport:
    return CommandReport(
        "run-report",
        results,
        summary=lambda: "\n".join(map(summary, results)),
        cases=lambda: _cases(results),
        document=_document,
    )


def _document(results: Sequence[Any]) -> dict[str, object]:
    from mjrun.outputs.run_report import RunResult

    return RunResult(results).document()


def _cases(results: Sequence[Any]) -> Iterator[CiVerdict]:
    """Yields a case for each assertion."""
    from mjrun.outputs.trace import TraceResult

    for result in results:
        for verdict in result.assertions if isinstance(result, TraceResult) else ():
            level, title = "" if verdict.passed else "error", f"mjrun run: {result.path}"
            yield CiVerdict(verdict.text, level, title, verdict.message)


def _plan_lines(plan: "PassPreview") -> Iterator[str]:
    yield f"simulation: {plan.duration:g} s in {plan.steps} steps of {plan.timestep:g} s"
    for output in plan.outputs:
        count = "an event decides how many" if output.count is None else str(output.count)
        size = f", {output.size[0]}x{output.size[1]}" if len(output.size) == 2 else ""
        about = clean(output.about)
        yield f"{output.kind}: {clean(output.path)}: {count} {output.unit}{size}; {about}"
