"""Run many simulations: grids, samples, randomization; resumable."""

import time
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import ON_FILES, ModelArgument, ParsedCommandLine, command
from mjrun.cli.console import CommandReport, Console
from mjrun.cli.simulation_command import (
    import_mujoco,
    is_study,
    load_controller,
    refuse_assignments,
    reported_failures,
    simulation,
    stem,
    varied_controllers,
    with_camera_scripts,
)
from mjrun.errors import FailedPointsError, FileError, ModelNotFoundError, UsageError, clean, counted, option
from mjrun.formats.input_file import exists, is_file, is_folder
from mjrun.options.every_command import opened_file
from mjrun.options.option import options_of
from mjrun.options.report import PageOptions
from mjrun.options.setting_kinds import NamedNumbersKind, SettingsKind
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.options.sweep import (
    MANIFEST,
    PARTS,
    PLANS,
    STOPPING,
    ExecutionOptions,
    KeptFileOptions,
    StudyCommandOptions,
    StudyOptions,
    VariationOptions,
)
from mjrun.platform.cores import available_cores
from mjrun.suffixes import is_url, is_yaml

if TYPE_CHECKING:
    from mjrun.study.job_plan import JobPlan
    from mjrun.study.study import Study, StudyResult

    Located = Callable[[], AbstractContextManager[None]]

# Options that do not affect the results of a study: the command line accepts them with its folder or its plan.
WITH_RESULTS = (
    "require",
    "confidence",
    *(each.attribute for cls in (KeptFileOptions, PageOptions) for each in options_of(cls)),
)
UNFINISHED = 1  # exit code of --status
ARGUMENTS = (
    ModelArgument("model", written=True, metavar="MODEL|STUDY.yaml|PLAN.jsonl|FOLDER", type=click.Path(readable=False)),
    click.Argument(["assignments"], metavar="[KEY=VALUE]...", nargs=-1),
)


@command(
    StudyOptions,
    StudyCommandOptions,
    ExecutionOptions,
    SimulationOptions,
    *ON_FILES,
    arguments=ARGUMENTS,
    python="Study",
    reports={
        "sweep": "mjrun.study.study:StudyResult",
        "sweep-status": "mjrun.study.status:StudyStatus",
    },
)
def sweep(console: Console, command_line: ParsedCommandLine) -> None:
    """Simulate MODEL for many parameter values and tabulate the results, one row per point.

    \b
    mjrun sweep scene.xml --vary opt.timestep=log:1e-4..1e-2:9 --metric 'drift=max(abs(energy/drift))' -o study
    mjrun sweep scene.xml --vary 'geom/*.friction[0]=uniform(0.3,1)' --samples 256 --metric 'x=last(com/x)' -o study
    mjrun sweep study.yaml samples=512 vary.seed=1..8:8 --dry-run

    STUDY.yaml is a study document; KEY=VALUE changes a value in it. FOLDER is an existing study: it is continued, and
    accepts additional files of points (--keep …) or different requirements (--require …).

    Repeating a command continues its study from the results in the folder. Exits with 8 if points failed.

    To distribute the simulations without an engine, write a plan, simulate its parts in any number of processes and
    in any order, and collect the results:

    \b
    mjrun sweep study.yaml --plan plan.jsonl
    mjrun sweep plan.jsonl --task 1/16
    mjrun sweep plan.jsonl --collect
    """
    options = command_line.make(StudyCommandOptions)
    _start_early(command_line)
    import_mujoco()
    if options.status:
        _report_status(console, command_line)
        return
    if options.gc:
        _remove_unused(console, command_line, dry_run=options.dry_run)
        return
    form = command_line.form("csv", "markdown")
    if options.task is not None:
        _simulate_task(console, command_line, *options.task)
        return
    study, located = _study(console, command_line)
    command_line.require(opened_file("contact_sheet", "keep"), study)
    console.page = study.html
    with located():
        if options.print_document:
            from mjrun.document.study import study_text

            console.result(study_text(study, console.command).rstrip("\n"))
        elif options.dry_run:
            from mjrun.cli.sweep_report import preview_report

            preview = study.preview()
            console.answer(CommandReport("", preview, lambda: preview_report(preview)))
        elif options.plan is not None:
            _write_plan(console, study, options.plan)
        else:
            from mjrun.document.study import with_document

            study = replace(with_document(study), with_csv=form == "csv")
            report = partial(_report, study, str(command_line.value("controller") or ""))
            with reported_failures(console, report, form=form):
                result = study.collect(console) if options.collect else study.run(console)
            console.answer(report([result]), form)


def _start_early(command_line: ParsedCommandLine) -> None:
    """Starts simulating processes in advance, if some will be needed."""
    other_task = any(command_line.explicit(StudyCommandOptions).get(name) for name in STOPPING)
    model = command_line.argument("model")
    folder = str(command_line.value("output") or (model if is_url(model) else f"{stem(command_line)}_study"))
    is_new = not any(exists(Path(place) / PARTS) for place in (folder, model))  # or in a store, which takes time to ask
    execution = command_line.make(ExecutionOptions)
    if not other_task and is_new and execution.engine == "local":
        from mjrun.child_process import may_fork
        from mjrun.study.point_server import start_early

        count = execution.jobs if isinstance(execution.jobs, int) else available_cores()
        if may_fork():
            import_mujoco()
            from mjrun.experiment.design import point_bound

            count = min(count, point_bound(command_line.make(VariationOptions)))
        start_early(count)


def _study(console: Console, command_line: ParsedCommandLine) -> "tuple[Study, Located]":
    """Returns the study of a command line or of its file, and the context that locates its errors."""
    from mjrun.study.study import Study

    model, assignments = command_line.argument("model"), command_line.arguments("assignments")
    if is_study(model):
        from mjrun.document.study import read_study

        code = command_line.with_converted("controller", load_controller).make(CodeOptions)
        beside = _beside_study(command_line, model)
        request = read_study(model, assignments, values=beside, code=code, command=console.command)
        _require_said_there(command_line, model)
        return request.made, request.located
    refuse_assignments(model, assignments)
    if _is_plan(model):
        if not command_line.make(StudyCommandOptions).collect:
            raise UsageError(f"{clean(model)} is a plan; give {option('task')} I/N or {option('collect')}")
        return replace(_plan(command_line).study, command=console.command), nullcontext
    if is_url(model) or is_file(Path(model) / MANIFEST):
        from mjrun.document.study import read_folder

        study = read_folder(model, _beside_study(command_line, model))
        _require_said_there(command_line, model)
        return replace(study, command=console.command), partial(_explained_move, model)
    if is_folder(model) and not any(Path(model).glob("*.xml")):
        raise FileError(model, "has no study.json", "a study is a folder that mjrun sweep has written")
    if command_line.value("output") is None:
        command_line = command_line.with_defaults(output=f"{stem(command_line)}_study")
    code = varied_controllers(command_line)
    facts = {"simulation": simulation(command_line), "command": console.command, "controllers": code}
    return with_camera_scripts(command_line).make(Study, **facts), nullcontext


@contextmanager
def _explained_move(folder: str) -> Generator[None]:
    """Explains in the `with` block why a study in `folder` does not find its model, if it does not."""
    try:
        yield
    except ModelNotFoundError as error:
        error.add_note(f"{clean(folder)}/{MANIFEST} names it by its path from this folder: move both together")
        raise


def _is_plan(path: str) -> bool:
    return Path(path).suffix.lower() in PLANS


def _plan(command_line: ParsedCommandLine) -> "JobPlan":
    from mjrun.document.study import read_plan

    path = command_line.argument("model")
    if not _is_plan(path):
        raise UsageError(f"{option('task')}: {clean(path)} is not a plan (.jsonl); {option('plan')} FILE writes one")
    plan = read_plan(path, _beside_study(command_line, path))
    _require_said_there(command_line, path)
    if plan is None:
        raise UsageError(f"{clean(path)} has no points: all results existed when it was made")
    return plan


def _beside_study(command_line: ParsedCommandLine, file: str) -> dict[str, object]:
    """Returns the options that may accompany the file of a study: its folder, and its execution."""
    own = _accepted_beside(file)
    options = command_line.explicit(ExecutionOptions)
    options |= {name: value for name, value in command_line.explicit(StudyOptions).items() if name in own}
    output = command_line.value("output")
    return options if output is None else {**options, "output": output}


def _accepted_beside(file: str) -> Sequence[str]:
    return ("export_to",) if is_yaml(file) else ("export_to", *WITH_RESULTS)


def _write_plan(console: Console, study: "Study", path: str) -> None:
    from mjrun.document.study import portable_document, write_plan
    from mjrun.study.job_plan import plan

    made = plan(replace(study, document=portable_document(study, study.output)))
    write_plan(path, made)
    if console.verbosity >= 0:
        console.result(f"{clean(path)}: {counted(made.count, 'point')}")


def _simulate_task(console: Console, command_line: ParsedCommandLine, task: int, tasks: int) -> None:
    from mjrun.study.job_plan import run_task
    from mjrun.study.results import status_counts

    result = run_task(_plan(command_line), task, tasks, console)
    counts = status_counts(result.statuses)
    known = result.points - result.missing - result.simulated
    facts = [
        f"task {task} of {tasks}: {counted(result.simulated, 'point')} simulated{f' ({counts})' if counts else ''}",
        *([f"{known:,} known already"] if known else []),
        *([f"{result.missing:,} left"] if result.missing else []),
    ]
    console.answer(
        CommandReport("", result, summary=lambda: f"{clean(result.path)}: {', '.join(facts)}; {result.wall:.1f} s")
    )
    console.code = FailedPointsError.exit_code if result.missing else 0


def _report_status(console: Console, command_line: ParsedCommandLine) -> None:
    from mjrun.cli.sweep_report import status_report
    from mjrun.study.status import REFRESH, study_status, write_status_page

    folder = _existing_folder(command_line, "status")
    status, page = study_status(folder), command_line.value("html")
    while page is not None:
        write_status_page(str(page), status)
        if status.is_finished or not status.running:
            break
        console.progress("points", status.done, status.points)
        time.sleep(REFRESH)
        status = study_status(folder)
    console.answer(CommandReport("sweep-status", status, summary=lambda: status_report(status)))
    console.code = 0 if status.is_finished else UNFINISHED


def _remove_unused(console: Console, command_line: ParsedCommandLine, *, dry_run: bool) -> None:
    from mjrun.cli.sweep_report import unused_report
    from mjrun.study.status import remove_unused

    unused = remove_unused(_existing_folder(command_line, "gc"), dry_run=dry_run)
    console.answer(CommandReport("", unused, summary=lambda: unused_report(unused)))


def _existing_folder(command_line: ParsedCommandLine, name: str) -> str:
    """Returns the folder of the study that the option `name` reads."""
    model, output = command_line.argument("model"), command_line.value("output")
    if output is None and (is_study(model) or _is_plan(model)):
        raise UsageError(f"{option(name)} requires the folder of the study: give it instead of {clean(model)}")
    if output is not None:
        return str(output)
    beside = f"{stem(command_line)}_study"
    return model if is_url(model) or is_folder(model) or not (exists(model) or is_folder(beside)) else beside


def _require_said_there(command_line: ParsedCommandLine, file: str) -> None:
    """Raises UsageError for options that belong in the file of the study."""
    own = _accepted_beside(file)
    ours = {"output", *own, *(each.name for cls in (CodeOptions, ExecutionOptions) for each in options_of(cls))}
    explicit = command_line.explicit(StudyOptions, SimulationOptions)
    for each in (*options_of(StudyOptions), *options_of(SimulationOptions)):
        if each.attribute in explicit and each.name not in ours:
            if not is_yaml(file):
                says = f"{option(each.name)}: {clean(file)} sets it already"
                raise UsageError(f"{says}; for another study, give its model or its document, and another folder")
            assignment = (
                f"{each.key}.NAME=VALUE"
                if isinstance(each.kind, SettingsKind | NamedNumbersKind)
                else f"{each.key}=VALUE"
            )
            raise UsageError(f"{option(each.name)} cannot accompany {clean(file)}; write {assignment} instead")


def _report(study: "Study", controller: str, results: "Sequence[StudyResult]") -> CommandReport:
    def summary() -> str:
        from mjrun.cli.sweep_report import study_report

        return study_report(result, study.simulation, controller)

    def markdown() -> str:
        from mjrun.cli.sweep_report import study_markdown

        return study_markdown(result, study.simulation)

    def table() -> str:
        from mjrun.formats.local_and_remote_folders import opened_at

        with opened_at(result.files[1], "table", [".csv"]) as file:
            return file.read().decode().rstrip("\n")

    result = results[0]
    forms = {"csv": table, "markdown": markdown}
    return CommandReport("sweep", result, summary=summary, forms=forms)
