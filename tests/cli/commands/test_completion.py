"""The command that prints the completion scripts."""

import pytest

from mjrun.cli.completion import SHELLS
from tests.conftest import Command


@pytest.mark.parametrize("shell", SHELLS)
def test_scripts_register_a_function_for_the_program(shell: str, mjrun_here: Command) -> None:
    done = mjrun_here("completion", shell)

    assert done.returncode == 0, done.stderr
    assert f"_MJRUN_COMPLETE={shell}_complete".encode() in done.stdout


def test_other_shells_are_refused_with_those_there_are(mjrun_here: Command) -> None:
    done = mjrun_here("completion", "zhs")

    assert done.returncode == 2
    assert b"did you mean 'zsh'" in done.stderr
