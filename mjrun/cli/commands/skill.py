"""Print instructions for coding agents: how to run, see and judge a model."""

from pathlib import Path

from mjrun.cli.click_command import ParsedCommandLine, command
from mjrun.cli.console import Console


@command()
def skill(console: Console, command_line: ParsedCommandLine) -> None:
    """Print instructions for coding agents, in the format of a SKILL.md: how to run, render and evaluate a
    model without a display.

    \b
    mkdir -p skills/mjrun && mjrun skill > skills/mjrun/SKILL.md
    """
    console.result((Path(__file__).parents[2] / "SKILL.md").read_text("utf-8").rstrip())
