"""Find errors in models and likely causes of errors; for CI."""

import click

from mjrun.cli.click_command import CommandLine, ModelArgument, command
from mjrun.cli.console import Console, flag
from mjrun.options.check import CheckOptions, CheckReportOptions
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.policy import PolicyOptions
from mjrun.options.report import REPORT_FORMATS, ReportFormatOptions

MODELS = ModelArgument("models", nargs=-1, type=click.Path(), metavar="MODEL...")


@command(
    CheckOptions,
    CheckReportOptions,
    ReportFormatOptions,
    PolicyOptions,
    ConfinementOptions,
    arguments=[MODELS],
    python="Check",
    reports={"check": "mjrun.check.check:CheckResult"},
)
def check(console: Console, command_line: CommandLine) -> None:
    """Find errors in each MODEL, and likely causes of later errors; a folder includes all models in it.

    \b
    mjrun check scene.xml
    mjrun check models/ --fail-on warning --ignore MJ201,MJ3
    mjrun check models/**/*.xml --sarif > check_report.sarif
    mjrun check task.yaml --policy policy.onnx
    mjrun check --explain MJ503

    A task document is checked for names, sizes and its policy, and simulated under random actions. Each model is
    checked in a separate process with limits on time and memory. Exits with 1 if a finding has at least the severity
    of --fail-on, and with 3 if a model does not load.
    """
    console.guard_stdout()
    form = command_line.form(*REPORT_FORMATS, "sarif", "statistics")
    options = command_line.make(CheckReportOptions)
    if options.list_:
        _list_rules(console)
        return
    if options.explain:
        _explain(console, options.explain.upper())
        return
    if not command_line.arguments("models"):
        raise click.UsageError("Missing argument 'MODEL...'.", click.get_current_context())
    from mjrun.cli.check_config import configured
    from mjrun.cli.check_report import check_report
    from mjrun.document.check import Check

    command_line = command_line.with_defaults(**configured(options.config))
    result = command_line.make(Check, models=command_line.arguments("models")).run(console, flag)
    report = check_report(result)
    console.answer(report, form)
    if result.code:
        console.fail(result.code, "FailedCheck", report.summary())


def _list_rules(console: Console) -> None:
    from mjrun.check.codes import TOPICS, topic
    from mjrun.cli.check_report import rule_table

    if console.as_json:
        rules = [
            {"code": code, "severity": rule.severity, "title": rule.title, "topic": topic(code)}
            for code, rule in rule_table().items()
        ]
        console.document({"rules": rules})
        return

    sections: list[str] = []
    for name in TOPICS.values():
        rules = (rule for rule in rule_table().values() if topic(rule.code) == name)
        sections.append("\n".join([f"{name}:", *(f"  {rule.code}  {rule.severity:7}  {rule.title}" for rule in rules)]))
    console.result("\n\n".join(sections))


def _explain(console: Console, code: str) -> None:
    from mjrun.check.codes import explanation
    from mjrun.cli.check_report import rule_table

    text = explanation(code)
    rule = rule_table()[code]
    if console.as_json:
        document = {"code": code, "severity": rule.severity, "title": rule.title, "explanation": text}
        console.document(document)
    else:
        console.result(f"# {code}: {rule.title}\n\nSeverity: {rule.severity}.\n\n{text.rstrip()}")
