"""Print the JSON Schema of a kind of document or report."""

from collections.abc import Iterator
from pkgutil import resolve_name
from typing import Any

import click

from mjrun.cli.click_command import ParsedCommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.main import COMMANDS, load_command
from mjrun.cli.simulation_command import import_mujoco
from mjrun.errors import UnknownNameError

OPTIONS = "options"


def _complete(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    return [kind for kind in kinds() if kind.startswith(incomplete)]


@command(arguments=[click.Argument(["kind"], shell_complete=_complete)])
def schema(console: Console, command_line: ParsedCommandLine) -> None:
    """Print the JSON Schema of a KIND of document, for editors and validators, or of a report printed with --json.

    Kinds of documents: camera, run, study, task, fit-document, eval-document. The kind of a command's report is the
    name of the command, such as video or bench. In addition, run-report is the report of mjrun run, excite that of
    mjrun fit --excite, verify that of mjrun trace --verify, and sweep-status that of mjrun sweep --status. mjrun info
    reports a task as info-task, and demonstrations in a file as info-demos. mjrun export reports datasets as episodes,
    and error is the report of any command that fails.

    The kind options prints the reference of all options of all commands as Markdown.

    \b
    mjrun schema camera > camera.schema.json
    """
    kind = command_line.argument("kind")
    if kind == OPTIONS:
        from mjrun.cli.options_reference import options_reference

        console.result(options_reference())
        return
    import_mujoco()
    if kind not in kinds():
        raise UnknownNameError("kind", kind, kinds())
    console.document(schema_of(kind))


def kinds() -> list[str]:
    """Returns all kinds of schemas."""
    from mjrun.document.json_schema import DOCUMENTS, ERROR

    return [*DOCUMENTS, *(kind for kind, _, _ in _reports()), ERROR, OPTIONS]


def schema_of(kind: str) -> dict[str, Any]:
    """Returns the JSON Schema of a kind of document or report."""
    from mjrun.document.json_schema import DOCUMENTS, failure_schema, json_schema, report_schema

    if kind in DOCUMENTS:
        return json_schema(kind)
    for name, title, report in _reports():
        if name == kind:
            return report_schema(kind, title, resolve_name(report))
    return failure_schema()


def _reports() -> Iterator[tuple[str, str, str]]:
    """Yields every kind of report with its command line and its dataclass."""
    for name in COMMANDS:
        for kind, report in load_command(name).declaration.reports.items():
            yield kind, f"mjrun {name}" if kind.startswith(name) else f"mjrun {name} --{kind}", report
