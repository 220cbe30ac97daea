"""`mjrun check`."""

from typing import TYPE_CHECKING, Any

import click

from mjrun.cli import options, values
from mjrun.cli.check_options import check_options
from mjrun.cli.console import Console, flag
from mjrun.errors import UsageError

if TYPE_CHECKING:
    from mjrun.check.check import CheckResult

FORMS = ("json", "sarif", "github")


@click.command("check", cls=options.SectionedCommand)
@click.argument("models", nargs=-1, type=click.Path(), metavar="MODEL...")
@check_options
@options.output_options
@click.pass_obj
def command(console: Console, /, as_json: bool, **given: Any) -> None:
    """Find what is wrong with each MODEL, or will be; a folder means all models below it.

    \b
    mjrun check scene.xml
    mjrun check models/ --fail-on warning --ignore MJ201,MJ3
    mjrun check models/**/*.xml --sarif > check_report.sarif

    Each model is looked at in a process of its own, within limits of time and memory. Exits with 1 when something at
    or above --fail-on is found, and with 3 when a model does not load.
    """
    console.guard_stdout()
    values.import_mujoco()
    given["json"] = as_json
    if given["list_"]:
        _show_rules(console, as_json)
        return
    if sum(given[form] for form in FORMS) > 1:
        raise UsageError("--json, --sarif and --github exclude each other: all want standard output")
    if not given["models"]:
        raise click.UsageError("Missing argument 'MODEL...'.", click.get_current_context())
    result = _checked(console, given)
    _show(console, given, result)
    console.code = result.code


def _checked(console: Console, given: dict[str, Any]) -> "CheckResult":
    from mjrun.check.check import Check

    same = ("models", "fail_on", "steps", "memory", "jobs")
    job = Check(
        select=[code for codes in given["select"] for code in codes],
        ignore=[code for codes in given["ignore"] for code in codes],
        timeout=float(given["timeout"]),
        **{name: given[name] for name in same},
    )
    return job.run(console, flag)


def _show(console: Console, given: dict[str, Any], result: "CheckResult") -> None:
    from mjrun.cli import check_report

    if given["json"]:
        console.document(check_report.document(result))
    elif given["sarif"]:
        console.document(check_report.sarif(result))
        console.say(check_report.summary(result))
    elif given["github"]:
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
