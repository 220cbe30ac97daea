"""Print a shell script that completes mjrun's commands, options and values."""

import click

from mjrun.cli.click_command import ParsedCommandLine, command
from mjrun.cli.console import Console
from mjrun.errors import UnknownNameError


@command(arguments=[click.Argument(["shell"], metavar="bash|zsh|fish")])
def completion(console: Console, command_line: ParsedCommandLine) -> None:
    """Print a script that completes mjrun's commands, options and values in a shell.

    Values include the models of a collection, and the cameras, keyframes, actuators, joints, columns and paths of the
    model on the command line. Add one of these lines to the shell's start-up file:

    \b
    eval "$(mjrun completion bash)"               # ~/.bashrc
    eval "$(mjrun completion zsh)"                # ~/.zshrc, after compinit
    mjrun completion fish | source                # ~/.config/fish/config.fish
    """
    from click.shell_completion import get_completion_class

    from mjrun.cli.completion import SHELLS
    from mjrun.cli.main import COMPLETE, group

    shell = command_line.argument("shell")
    if shell not in SHELLS:
        raise UnknownNameError("shell", shell, SHELLS)
    kind = get_completion_class(shell)
    assert kind is not None
    console.result((kind.source_template % kind(group, {}, "mjrun", COMPLETE).source_vars()).strip())
