"""The reference of all options of all commands, as Markdown."""

from collections.abc import Iterator

import click

from mjrun.cli.click_command import DeclaredOption
from mjrun.cli.main import COMMANDS, group


def reference() -> str:
    """One section for each command, a table for each of its groups of options."""
    return "\n".join(_lines())


def _lines() -> Iterator[str]:
    yield "# Options of mjrun\n"
    yield "An option means the same in every command. Run documents and Python use its name with underscores."
    ctx = click.Context(group)
    for name in COMMANDS:
        command = group.get_command(ctx, name)
        assert command
        yield f"\n## mjrun {name}\n\n{COMMANDS[name]}"
        section = ""
        for param in command.params:
            if not isinstance(param, DeclaredOption):
                continue
            if param.section != section:
                section = param.section
                yield f"\n### {section}\n\n| option | meaning |\n|---|---|"
            spelling, meaning = param.get_help_record(ctx) or ("", "")
            yield f"| `{_cell(spelling)}` | {_cell(meaning)} |"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
