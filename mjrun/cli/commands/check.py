"""Find errors in models and likely causes of errors; for CI."""

import os
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from mjrun.cli.click_command import ON_FILES, WORDS, ModelArgument, ParsedCommandLine, command
from mjrun.cli.console import Console, flag
from mjrun.cli.simulation_command import import_mujoco
from mjrun.confinement.confinement import is_readable
from mjrun.errors import FileError, UnknownNameError, UsageError, clean, option
from mjrun.formats.input_file import exists, is_file, opened
from mjrun.options.check import CheckOptions, CheckReportOptions
from mjrun.options.every_command import opened_file
from mjrun.options.option import OptionRequirement, options_of
from mjrun.options.policy import PolicyOptions
from mjrun.options.report import REPORT_FORMATS, ReportFormatOptions

if TYPE_CHECKING:
    from mjrun.check.check_page import FindingCards
    from mjrun.check.rule import Rule

REPORT_SUFFIXES = (".sarif", ".json", ".jsonl", ".md", ".txt")  # of files that are no models
FIXED_BY = {"safe": "--fix", "unsafe": "--fix --unsafe-fixes"}
MODELS = ModelArgument("models", nargs=-1, type=click.Path(readable=False), metavar="MODEL...")
# The sections of files with defaults, by file, in order of precedence.
SECTIONS = {"mjrun.toml": ("check",), "pyproject.toml": ("tool", "mjrun", "check")}
LARGEST_CONFIG = 2**20  # bytes
TOML = (".toml",)


@command(
    CheckOptions,
    CheckReportOptions,
    ReportFormatOptions,
    PolicyOptions,
    *ON_FILES,
    arguments=[MODELS],
    python="Check",
    reports={"check": "mjrun.check.check:CheckResult"},
)
def check(console: Console, command_line: ParsedCommandLine) -> None:
    """Find errors in each MODEL, and likely causes of later errors; a folder includes all models in it.

    \b
    mjrun check scene.xml
    mjrun check models/ --fail-on warning --ignore MJ201,MJ3
    mjrun check models/**/*.xml --sarif > check_report.sarif
    mjrun check task.yaml --policy policy.onnx
    mjrun check robots/ --fix --unsafe-fixes --diff
    mjrun check --explain MJ503

    A task document is checked for names, sizes and its policy, and simulated under random actions. Each model is
    checked in a separate process with limits on time and memory. --fix edits the text of the models where the fix is
    certain. Exits with 1 if a finding is left that has at least the severity of --fail-on, or if --diff or --dry-run
    would fix something, and with 3 if a model does not load.
    """
    form = command_line.form(*REPORT_FORMATS, "sarif", "statistics", "diff", "scan", "json_lines")
    options = command_line.make(CheckReportOptions)
    if options.list_:
        _list_rules(console)
        return
    if options.explain:
        _explain(console, options.explain.upper())
        return
    if not command_line.arguments("models"):
        raise click.UsageError("Missing argument 'MODEL...'.", click.get_current_context())
    if form:
        _require_models(command_line.arguments("models"), form)
    from mjrun.cli.check_report import check_report, model_line, write_findings
    from mjrun.document.model_and_task_check import Check

    written, command_line = command_line, command_line.with_defaults(**configured(options.config))
    if options.diff:
        command_line = command_line.with_defaults(fix=True, dry_run=True)
    if options.scan:
        command_line = command_line.with_defaults(skip_other=True)
    if command_line.value("fix") or any(":" in model for model in command_line.arguments("models")):
        import_mujoco()  # names in collections need it, too
    job = command_line.make(Check, models=command_line.arguments("models"))
    command_line.require(opened_file("table"), options)
    written.require(OptionRequirement("unsafe_fixes", "fix", "which then makes more changes"), job)
    _require_outputs(options)
    cards = _cards(console) if options.html else None
    result = job.run(
        console,
        flag,
        lambda each: console.result(model_line(each)) if options.json_lines else None,
        cards.add_fixes if cards else None,
    )
    if options.table:
        write_findings(options.table, result)
    report = check_report(result)
    if options.html and cards:
        from mjrun.check.check_page import write_check_page

        write_check_page(options.html, result, report.summary(), cards, console.command)
    console.answer(report, form)
    if result.code:
        console.fail(result.code, "FailedCheck", report.summary())


def _cards(console: Console) -> "FindingCards":
    """Returns the maker of the cards of a page, which imports MuJoCo."""
    import_mujoco()
    from mjrun.check.check_page import FindingCards

    return FindingCards(console)


def _require_models(paths: Sequence[str], form: str) -> None:
    """Refuses the name of a new file after an option that prints the report to standard output."""
    words: Sequence[str] = click.get_current_context().meta[WORDS]
    following = {after for word, after in pairwise(words) if word == flag(form)} if len(paths) > 1 else ()
    for path in paths:
        is_report = Path(path).suffix in REPORT_SUFFIXES or path in following
        if is_report and not exists(path):
            raise UsageError(f"{option(form)} prints to standard output; write > {clean(path)} after the command")


def _require_outputs(options: CheckReportOptions) -> None:
    """Checks that the table and the page can be written, before models are checked."""
    if options.table:
        from mjrun.formats.tables import output_format

        output_format(options.table)
    if options.html:
        from mjrun.plotting.html_page import check_page_name

        check_page_name(options.html)
    for path in filter(None, (options.table, options.html)):
        from mjrun.formats.output_writer import StagedFile

        StagedFile(Path(path)).cleanup()


def _list_rules(console: Console) -> None:
    from mjrun.check.rule_catalogue import TOPICS, topic
    from mjrun.cli.check_report import rule_table

    if console.document_form:
        rules = [
            {"code": code, "severity": rule.severity, "title": rule.title, "topic": topic(code), "fix": rule.fix}
            for code, rule in rule_table().items()
        ]
        console.document({"rules": rules})
        return

    sections: list[str] = []
    for name in TOPICS.values():
        rules = (rule for rule in rule_table().values() if topic(rule.code) == name)
        sections.append("\n".join([f"{name}:", *(f"  {_line(rule)}" for rule in rules)]))
    console.result("\n\n".join(sections))


def _line(rule: "Rule") -> str:
    fixed = f" [{FIXED_BY[rule.fix]}]" if rule.fix else ""
    return f"{rule.code}  {rule.severity:7}  {rule.title}{fixed}"


def _explain(console: Console, code: str) -> None:
    from mjrun.check.rule_catalogue import explanation
    from mjrun.cli.check_report import rule_table

    text = explanation(code)
    rule = rule_table()[code]
    if console.document_form:
        document = {"code": code, "severity": rule.severity, "title": rule.title, "fix": rule.fix, "explanation": text}
        console.document(document)
    else:
        fixed = f" Fixed by {FIXED_BY[rule.fix]}." if rule.fix else ""
        console.result(f"# {code}: {rule.title}\n\nSeverity: {rule.severity}.{fixed}\n\n{text.rstrip()}")


def configured(config: str | None) -> dict[str, object]:
    """Returns the options in a file, by name; without one, in the nearest file that has some.

    Paths and patterns are relative to the folder of the file, which contains the baseline: a configuration is not
    trusted to name other files that are written.

    Raises:
      FileError: the file cannot be read, or contains an invalid option.
    """
    paths = _nearest() if config is None else iter([Path(config)])
    for path in paths:
        section = _section(path)
        if section is not None:
            return _options(path, section)
    if config is not None:
        raise FileError(config, f"has no section [{'.'.join(SECTIONS['pyproject.toml'])}] or [check]")
    return {}


def _nearest() -> Iterator[Path]:
    """Yields the files that may contain options, from the working folder upwards."""
    here = Path.cwd()
    for folder in (here, *here.parents):
        yield from (folder / name for name in SECTIONS if is_readable(folder / name) and is_file(folder / name))


def _section(path: Path) -> Mapping[str, object] | None:
    """Returns the section with options of check; None if the file has none."""
    import tomllib  # slow to import, and most folders have no such file

    with opened(path, "configuration", TOML) as file:
        text = file.read(LARGEST_CONFIG)
    try:
        document: object = tomllib.loads(text.decode())
    except (ValueError, RecursionError) as error:
        raise FileError(path, f"is not valid TOML: {error}") from error

    for name in SECTIONS.get(path.name, ("check",)):
        document = cast("dict[str, object]", document).get(name) if isinstance(document, dict) else None
    return cast("dict[str, object]", document) if isinstance(document, dict) else None


def _options(path: Path, section: Mapping[str, object]) -> dict[str, object]:
    """Returns the options in a section, by name, with paths relative to the working folder."""
    from mjrun.check.check import ModelCheck

    declared = {each.name: each.attribute for each in options_of(CheckOptions) if each.name != "changed_since"}
    folder = os.path.relpath(path.parent)
    values: dict[str, Any] = {}
    try:
        for key, value in section.items():
            name = key.replace("-", "_")
            if name == "changed_since":
                raise UsageError(f"{key} runs git, which runs programs that a repository names: give {option(name)}")
            if name not in declared:
                raise UnknownNameError("option", key, [each.replace("_", "-") for each in declared])
            values[name] = _relative(name, value, "" if folder == os.curdir else folder)
        if isinstance(baseline := values.get("baseline"), str):  # which may be replaced
            _require_inside(baseline, path)
        checked = ModelCheck((), **{declared[name]: value for name, value in values.items()})
    except UsageError as error:
        message, _, hint = str(error).partition("\n")
        raise FileError(path, message, hint) from error
    return {name: getattr(checked, declared[name]) for name in values}


def _require_inside(baseline: str, config: Path) -> None:
    """Raises UsageError for a baseline that is outside the folder of the configuration that names it."""
    try:
        is_inside = config.parent.resolve() in Path(baseline).resolve().parents
    except (OSError, RuntimeError):  # links in a circle
        is_inside = False
    if not is_inside:
        raise UsageError(f"{clean(baseline)} is outside the folder of {config.name}\n{option('baseline')} may name it")


def _relative(name: str, value: object, folder: str) -> object:
    """Returns the value of an option with its paths relative to the working folder."""
    if name == "baseline" and isinstance(value, str):
        return str(Path(folder, value))
    if name == "ignore_in" and isinstance(value, dict):
        patterns = cast("dict[str, object]", value)
        return {Path(folder, pattern).as_posix(): _joined(codes) for pattern, codes in patterns.items()}
    return value


def _joined(codes: object) -> object:
    """Returns a list of codes as one text."""
    return ",".join(map(str, cast("list[object]", codes))) if isinstance(codes, list) else codes
