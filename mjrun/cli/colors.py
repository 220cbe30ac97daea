"""Colours of help and of messages on terminals that want them, and the width of help."""

import os
import re
import sys
from contextlib import suppress
from typing import TextIO

import click

HELP_COLUMNS = 100  # most columns of help
HEADING = r"(?m)^(Usage:|\S.*:$)"  # patterns are compiled when they are used
OPTION = r"(?m)^(  )((?:-\w, )?--?[\w-]+(?:, ?--?[\w-]+|/--?[\w-]+)*)"
COMMAND = r"(?m)^(  )([a-z]+)(?=  )"
# Variables and values by which terminals make themselves known that show hyperlinks (OSC 8).
LINKING_PROGRAMS = ("iTerm.app", "WezTerm", "vscode", "Hyper", "ghostty", "Tabby", "rio")
LINKING_TERMS = ("xterm-kitty", "xterm-ghostty", "alacritty", "foot", "foot-extra", "wezterm")
LINKING_VARIABLES = ("WT_SESSION", "KONSOLE_VERSION", "KITTY_WINDOW_ID", "DOMTERM")
LINKING_VTE = 5000  # the first version of the library of GNOME's and other terminals
PREFIX = r"^(mjrun: )(error|warning)(:)"
LEVELS = {"error": "red", "warning": "yellow"}


def is_coloured(stream: TextIO) -> bool:
    """Returns whether a stream is a terminal that shows colours: see no-color.org."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def shows_links(stream: TextIO) -> bool:
    """Returns whether a stream is a terminal that is known to show hyperlinks; FORCE_HYPERLINK overrides that."""
    given = os.environ.get
    if forced := given("FORCE_HYPERLINK"):
        return forced != "0"
    if not stream.isatty() or given("TMUX") or given("STY") or given("TERM") == "dumb":
        return False
    version = given("VTE_VERSION", "")
    return (
        any(map(given, LINKING_VARIABLES))
        or given("TERM_PROGRAM") in LINKING_PROGRAMS
        or given("TERM") in LINKING_TERMS
        or (version.isdigit() and int(version) >= LINKING_VTE)
    )


def linked(text: str, address: str) -> str:
    """Returns a text that a terminal shows as a hyperlink: see https://gist.github.com/egmontkob/eb114294efbcd5adb1944c9f3cb5feda."""
    return f"\x1b]8;;{address}\x1b\\{text}\x1b]8;;\x1b\\"


class HelpContext(click.Context):
    """A context whose help is as wide as the terminal; click asks `shutil` for that, which is slow to import."""

    def make_formatter(self) -> click.HelpFormatter:
        return click.HelpFormatter(width=max(min(_columns(), HELP_COLUMNS) - 2, 50))


def _columns() -> int:
    """Returns the width of the terminal as `shutil.get_terminal_size` does."""
    with suppress(ValueError):
        if (columns := int(os.environ.get("COLUMNS", "0"))) > 0:
            return columns
    with suppress(AttributeError, ValueError, OSError):  # standard output is no terminal
        return os.get_terminal_size(sys.__stdout__.fileno()).columns or 80  # type: ignore[union-attr]
    return 80


def shown_help(text: str) -> str:
    """Returns help as standard output shows it."""
    return coloured_help(text) if is_coloured(sys.stdout) else text


def coloured_help(text: str) -> str:
    """Returns help with bold headings, and coloured options and commands."""
    text = re.sub(HEADING, lambda match: click.style(match[0], bold=True), text)
    for pattern in (OPTION, COMMAND):
        text = re.sub(pattern, lambda match: match[1] + click.style(match[2], fg="cyan"), text)
    return text


def coloured_message(text: str) -> str:
    """Returns an error or a warning with its first words coloured."""
    return re.sub(PREFIX, lambda match: click.style(match[0], fg=LEVELS[match[2]], bold=True), text)
