"""`mjrun sweep`."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.controller_loader import load_controller
from mjrun.cli.simulation_command import failures_in_json, import_mujoco, simulation, stem
from mjrun.errors import MjrunError, UsageError, clean, option
from mjrun.options.kinds import Settings, Values
from mjrun.options.messages import MessageOptions
from mjrun.options.simulation import ControllerOptions, SimulationOptions
from mjrun.options.sweep import ExecutionOptions, StudyCommandOptions, StudyOptions

if TYPE_CHECKING:
    from mjrun.study.study import Study, StudyResult

    Located = Callable[[], AbstractContextManager[None]]

ARGUMENTS = (
    click.Argument(["model"], metavar="MODEL|STUDY.yaml", type=click.Path()),
    click.Argument(["assignments"], metavar="[KEY=VALUE]...", nargs=-1),
)


@command("sweep", StudyOptions, StudyCommandOptions, ExecutionOptions, SimulationOptions, arguments=ARGUMENTS)
def sweep(console: Console, command_line: CommandLine) -> None:
    """Simulate MODEL for many values, and tell what happens: a table with a row for each point.

    \b
    mjrun sweep scene.xml --vary opt.timestep=log:1e-4..1e-2:9 --metric 'drift=max(abs(energy/drift))' -o study
    mjrun sweep scene.xml --vary 'geom/*.friction[0]=uniform(0.3,1)' --samples 256 --metric 'x=last(com/x)' -o study
    mjrun sweep study.yaml samples=512 vary.seed=1..8:8 --dry-run

    STUDY.yaml is a document that says all of it; KEY=VALUE changes a value of it.

    The folder keeps what is known: the same command again continues it. Exits with 8 when points failed.
    """
    console.guard_stdout()
    import_mujoco()

    study, located = _study(console, command_line)
    options = command_line.make(StudyCommandOptions)
    with located():
        if options.print_document:
            from mjrun.document.run_writer import study_text

            console.result(study_text(study, console.command).rstrip("\n"))
        elif options.dry_run:
            _show_preview(console, command_line, study)
        else:
            _show_result(console, command_line, study, lambda: study.run(console))


def _study(console: Console, command_line: CommandLine) -> "tuple[Study, Located]":
    """The study of a command line, or of the document that it names; and what locates its errors there."""
    from mjrun.document.study import is_document, read_study
    from mjrun.study.study import Study

    model, assignments = command_line.argument("model"), command_line.arguments("assignments")
    if is_document(model):
        _require_said_there(command_line, model)
        code = command_line.with_converted("controller", load_controller).make(ControllerOptions)
        given = command_line.given(ExecutionOptions)
        if command_line.value("output") is not None:
            given["output"] = command_line.value("output")
        request = read_study(model, assignments, given=given, code=code, command=console.command)
        return request.study, request.located
    if assignments:
        raise UsageError(f"{clean(assignments[0])}: {clean(model)} is no document whose values could be changed")
    if command_line.value("output") is None:
        command_line = command_line.with_defaults(output=f"{stem(command_line)}_study")
    study = command_line.make(Study, simulation=simulation(command_line), command=console.command)
    return study, nullcontext


def _require_said_there(command_line: CommandLine, document: str) -> None:
    """Raises UsageError for options that the document has to say."""
    from mjrun.options.option import options_of

    ours = {"output", *(each.name for cls in (ControllerOptions, ExecutionOptions) for each in options_of(cls))}
    given = command_line.given(StudyOptions, SimulationOptions)
    for each in (*options_of(StudyOptions), *options_of(SimulationOptions)):
        if each.attribute in given and each.name not in ours:
            assignment = f"{each.key}.NAME=VALUE" if isinstance(each.kind, Settings | Values) else f"{each.key}=VALUE"
            raise UsageError(f"{option(each.name)}: {clean(document)} says that; change it as in {assignment}")


def _show_preview(console: Console, command_line: CommandLine, study: "Study") -> None:
    from mjrun.cli.sweep_report import preview_report

    preview = study.preview()
    if command_line.make(MessageOptions).json:
        console.document(asdict(preview))
    else:
        console.result(preview_report(preview))


def _show_result(console: Console, command_line: CommandLine, study: "Study", run: "Callable[[], StudyResult]") -> None:
    from mjrun.cli.sweep_report import study_report

    as_json = command_line.make(MessageOptions).json
    try:
        with failures_in_json(console, command_line, lambda results: asdict(results[0])):
            result = run()
    except MjrunError as error:
        if error.results and not as_json:
            console.result(study_report(error.results[0], study.simulation))
        raise
    if as_json:
        console.document(asdict(result))
    else:
        console.result(study_report(result, study.simulation))
