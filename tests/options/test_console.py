"""Options of the console, which every command has, and nothing but commands."""

import click
import pytest

from mjrun.cli.main import COMMANDS, group
from mjrun.options.console import ConsoleOptions
from mjrun.options.option import FrontEnd, options_of

NAMES = {each.name for each in options_of(ConsoleOptions)}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_them(name: str) -> None:
    command = group.get_command(click.Context(group), name)
    assert command
    assert {param.name for param in command.params} >= NAMES == {"json", "quiet", "verbose", "debug"}


def test_they_are_of_the_command_line_alone_and_off() -> None:
    assert {each.places for each in options_of(ConsoleOptions)} == {FrontEnd.COMMAND}
    assert not any(each.default for each in options_of(ConsoleOptions))
