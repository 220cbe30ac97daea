"""`mjrun schema`."""

import click

from mjrun.cli import options, values
from mjrun.cli.console import Console

KINDS = ("camera", "run", "bench")


@click.command("schema", cls=options.SectionedCommand)
@click.argument("kind", type=click.Choice(KINDS))
@click.pass_obj
def command(console: Console, /, kind: str) -> None:
    """Print the JSON Schema of a kind of document, or of what mjrun bench --json reports, for editors and validators.

    \b
    mjrun schema camera > camera.schema.json
    """
    console.guard_stdout()
    values.import_mujoco()
    from mjrun.document.json_schema import schema

    console.document(schema(kind))
