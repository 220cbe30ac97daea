"""`mjrun check`."""

from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import CommandLine, command
from mjrun.cli.console import Console, flag
from mjrun.cli.simulation_command import import_mujoco
from mjrun.errors import UsageError, option
from mjrun.options.check import CheckOptions, CheckReportOptions
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.console import ConsoleOptions
from mjrun.options.policy import PolicyOptions

if TYPE_CHECKING:
    from mjrun.check.check import CheckResult

MODELS = click.Argument(["models"], nargs=-1, type=click.Path(), metavar="MODEL...")


@command("check", CheckOptions, CheckReportOptions, PolicyOptions, ConfinementOptions, arguments=[MODELS])
def check(console: Console, command_line: CommandLine) -> None:
    """Find what is wrong with each MODEL, or will be; a folder means all models below it.

    \b
    mjrun check scene.xml
    mjrun check models/ --fail-on warning --ignore MJ201,MJ3
    mjrun check models/**/*.xml --sarif > check_report.sarif
    mjrun check task.yaml --policy policy.onnx

    Of a task document it checks what does not fit: names, sizes, the policy, and what random actions bring to light.
    Each model is looked at in a process of its own, within limits of time and memory. Exits with 1 when something at
    or above --fail-on is found, and with 3 when a model does not load.
    """
    console.guard_stdout()
    import_mujoco()
    report, as_json = command_line.make(CheckReportOptions), command_line.make(ConsoleOptions).json
    if report.list_:
        _show_rules(console, as_json)
        return
    if as_json and (report.sarif or report.github):
        others = f"{option('sarif')} and {option('github')}"
        raise UsageError(f"{option('json')} excludes {others}: all want standard output")
    if not command_line.arguments("models"):
        raise click.UsageError("Missing argument 'MODEL...'.", click.get_current_context())
    from mjrun.document.check import Check

    result = command_line.make(Check, models=command_line.arguments("models")).run(console, flag)
    _show(console, report, as_json, result)
    if result.code:
        from mjrun.cli.check_report import summary

        console.fail(result.code, "FailedCheck", summary(result))


def _show(console: Console, report: CheckReportOptions, as_json: bool, result: "CheckResult") -> None:
    from mjrun.cli import check_report

    if as_json:
        console.document(check_report.document(result))
    elif report.sarif:
        console.document(check_report.sarif(result))
        console.say(check_report.summary(result))
    elif report.github:
        for line in check_report.annotations(result):
            console.result(line)
        console.say(check_report.summary(result))
    else:
        for line in check_report.lines(result):
            console.result(line)
        if console.verbosity >= 0:
            console.result(check_report.summary(result))


def _show_rules(console: Console, as_json: bool) -> None:
    from mjrun.check.rule_table import RULES

    if as_json:
        console.document(
            {"rules": [{"code": code, "severity": r.severity, "title": r.title} for code, r in RULES.items()]}
        )
        return
    for code, rule in RULES.items():
        console.result(f"{code}  {rule.severity:7}  {rule.title}")
