"""`mjrun eval`."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import import_mujoco, results_of_failures, with_camera_scripts
from mjrun.errors import MjrunError, UsageError, option
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.console import ConsoleOptions
from mjrun.options.evaluation import EvaluationCommandOptions, EvaluationExecutionOptions, EvaluationOptions
from mjrun.suffixes import is_yaml

if TYPE_CHECKING:
    from mjrun.evaluation.evaluation import Evaluation
    from mjrun.evaluation.result import EvaluationResult

    Located = Callable[[], AbstractContextManager[None]]

ARGUMENTS = (
    click.Argument(["task"], metavar="TASK|EVALUATION.yaml", type=click.Path()),
    click.Argument(["assignments"], metavar="[KEY=VALUE]...", nargs=-1),
)


@command(
    "eval",
    EvaluationOptions,
    EvaluationExecutionOptions,
    EvaluationCommandOptions,
    ConfinementOptions,
    arguments=ARGUMENTS,
    without=["repeats"],
)
def eval(console: Console, command_line: CommandLine) -> None:  # noqa: A001 - the command's name
    """Play seeded episodes of TASK under a policy, and tell how good it is: returns, successes, films.

    \b
    mjrun eval task.yaml --policy drive.onnx --episodes 200 -o results
    mjrun eval task.yaml --policy walk.onnx --films 3 --metric 'effort=mean(abs(ctrl/hip))'
    mjrun eval task.yaml --policy new.onnx --compare old.onnx --fail-below success=90%
    mjrun eval task.yaml --policy walk.onnx --vary 'geom/floor.friction[0]=0.2,0.6,1'
    mjrun eval gym:Walker2d-v5 --policy random --episodes 20
    mjrun eval evaluation.yaml --policy new.onnx episodes=20

    TASK is a task document, whose values KEY=VALUE changes, one of ours, such as scene:car_drive, or an environment of
    Gymnasium's. Episode i has the seed of the first plus i, and mjrun video TASK --policy P --seed S shows the episode
    of seed S. The same seeds give the same table, bit for bit. Exits with 1 where what is required does not hold.

    EVALUATION.yaml is a document that says all of it; KEY=VALUE changes a value of it, and options count instead of it.
    """
    console.guard_stdout()
    import_mujoco()
    options = command_line.make(EvaluationCommandOptions)
    if options.csv and command_line.make(ConsoleOptions).json:
        raise UsageError(f"{option('csv')} and {option('json')} both want standard output")
    evaluation, changes, located = _evaluation(console, command_line)
    with located():
        if options.print_document:
            from mjrun.document.evaluation_writer import evaluation_text

            console.result(evaluation_text(evaluation, changes, console.command).rstrip("\n"))
        else:
            _show(console, command_line, lambda: evaluation.run(console), as_csv=options.csv)


def _evaluation(console: Console, command_line: CommandLine) -> "tuple[Evaluation, Sequence[str], Located]":
    """The evaluation of a command line, or of the document that it names; what it changes in the task; and what
    locates its errors."""
    from mjrun.document.evaluation import evaluated_task, read_evaluation
    from mjrun.document.kinds import KINDS, kind_of_file
    from mjrun.evaluation.evaluation import Evaluation

    path, assignments = command_line.argument("task"), command_line.arguments("assignments")
    command_line = with_camera_scripts(command_line)
    if is_yaml(path) and kind_of_file(path) == KINDS["Evaluation"]:
        values = command_line.explicit(EvaluationOptions, EvaluationExecutionOptions)
        request = read_evaluation(path, assignments, values=values, command=console.command)
        return request.made, request.changes, request.located
    task, rewritten = evaluated_task(path, assignments)
    command_line = command_line.with_defaults(output=f"{task.stem}_eval")
    made = command_line.make(Evaluation, task=task, rewritten=rewritten, command=console.command)
    return made, assignments, nullcontext


def _show(console: Console, command_line: CommandLine, run: "Callable[[], EvaluationResult]", *, as_csv: bool) -> None:
    from mjrun.cli.eval_report import evaluation_report
    from mjrun.evaluation.table import FILES

    def show(result: "EvaluationResult") -> None:
        report = evaluation_report(result)
        if as_csv:
            console.say(report)
            console.result(Path(result.path, FILES[1]).read_text("utf-8").rstrip("\n"))
        elif console.verbosity >= 0:
            console.result(report)

    as_json = command_line.make(ConsoleOptions).json
    try:
        with results_of_failures(console, lambda results: asdict(results[0])):
            result = run()
    except MjrunError as error:
        if error.results and not as_json:
            show(error.results[0])
        raise
    if as_json:
        console.document(asdict(result))
    else:
        show(result)
