"""`mjrun schema`."""

import click

from mjrun.cli.click_command import CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import import_mujoco
from mjrun.document.schema_kinds import DOCUMENTS, ERROR, REPORTS

KINDS = (*DOCUMENTS, *REPORTS, ERROR, "options")


@command("schema", arguments=[click.Argument(["kind"], type=click.Choice(KINDS))])
def schema(console: Console, command_line: CommandLine) -> None:
    """Print the JSON Schema of a kind of document, for editors and validators, or of the reports of a command.

    bench, diff, eval, fit, plot, sweep and view are what these commands report with --json; excite is what mjrun fit
    --excite reports, and verify what mjrun trace --verify does; error is what any command prints when it fails.

    options prints a reference of all options of all commands instead, as Markdown.

    \b
    mjrun schema camera > camera.schema.json
    """
    console.guard_stdout()
    if command_line.argument("kind") == "options":
        from mjrun.cli.options_reference import options_reference

        console.result(options_reference())
        return
    import_mujoco()
    from mjrun.document.json_schema import json_schema

    console.document(json_schema(command_line.argument("kind")))
