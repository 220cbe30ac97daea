"""`mjrun run`."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.controller_loader import load_controller
from mjrun.cli.result_summary import summary
from mjrun.cli.simulation_command import import_mujoco, results_of_failures
from mjrun.errors import MjrunError, clean
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.console import ConsoleOptions
from mjrun.options.run import RunOptions

if TYPE_CHECKING:
    from mjrun.outputs.output import OutputResult
    from mjrun.outputs.perform import PassPreview

ARGUMENTS = (
    click.Argument(["document"], type=click.Path()),
    click.Argument(["assignments"], metavar="[KEY=VALUE]...", nargs=-1),
)


@command("run", RunOptions, ConfinementOptions, arguments=ARGUMENTS)
def run(console: Console, command_line: CommandLine) -> None:
    """Make everything that DOCUMENT asks for: videos, images, traces and plots of one simulation, in one pass.

    \b
    mjrun run study.yaml
    mjrun run study.yaml duration=2 'videos[0].size=640x360' -o out
    mjrun run study.yaml --html study.html
    mjrun run study.yaml --dry-run
    """
    console.guard_stdout()
    import_mujoco()
    from mjrun.document.run import read_run
    from mjrun.outputs.perform import perform, preview
    from mjrun.outputs.run_page import run_page

    options = command_line.with_converted("controller", load_controller).make(RunOptions)
    as_json = command_line.make(ConsoleOptions).json
    document, assignments = command_line.argument("document"), command_line.arguments("assignments")
    requests = read_run(document, assignments, options, console.command)
    with requests.located():
        if options.dry_run:
            _show_plan(console, preview(requests.jobs, console), as_json)
            return
        with results_of_failures(console, _document):
            try:
                with run_page(requests.page, Path(document).name, requests.jobs) as published:
                    results = perform(requests.jobs, console, published)
            except MjrunError as error:
                if not as_json:
                    _show_results(console, error.results)
                raise
    if as_json:
        console.document(_document(results))
    else:
        _show_results(console, results)


def _show_results(console: Console, results: "Sequence[OutputResult]") -> None:
    if console.verbosity >= 0:
        for result in results:
            console.result(summary(result))


def _document(results: "Sequence[OutputResult]") -> dict[str, object]:
    return {"results": [{"kind": type(r).__name__.removesuffix("Result"), **asdict(r)} for r in results]}


def _show_plan(console: Console, plan: "PassPreview", as_json: bool) -> None:
    if as_json:
        console.document(asdict(plan))
        return
    console.result(f"simulation: {plan.duration:g} s in {plan.steps} steps of {plan.timestep:g} s")
    for output in plan.outputs:
        count = "an event decides how many" if output.count is None else str(output.count)
        size = f", {output.size[0]}x{output.size[1]}" if len(output.size) == 2 else ""
        about = clean(output.about)
        console.result(f"{output.kind}: {clean(output.path)}: {count} {output.unit}{size}; {about}")
