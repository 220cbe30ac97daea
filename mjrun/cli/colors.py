"""Colours of help and of messages, on terminals that want them."""

import os
import re
import sys
from typing import TextIO

import click

HEADING = re.compile(r"^(Usage:|\S.*:$)", re.MULTILINE)
OPTION = re.compile(r"^(  )((?:-\w, )?--?[\w-]+(?:, ?--?[\w-]+|/--?[\w-]+)*)", re.MULTILINE)
COMMAND = re.compile(r"^(  )([a-z]+)(?=  )", re.MULTILINE)
# Variables and values by which terminals make themselves known that show hyperlinks (OSC 8).
LINKING_PROGRAMS = ("iTerm.app", "WezTerm", "vscode", "Hyper", "ghostty", "Tabby", "rio")
LINKING_TERMS = ("xterm-kitty", "xterm-ghostty", "alacritty", "foot", "foot-extra", "wezterm")
LINKING_VARIABLES = ("WT_SESSION", "KONSOLE_VERSION", "KITTY_WINDOW_ID", "DOMTERM")
LINKING_VTE = 5000  # the first version of the library of GNOME's and other terminals
PREFIX = re.compile(r"^(mjrun: )(error|warning)(:)")
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


def shown_help(text: str) -> str:
    """Returns help as standard output shows it."""
    return coloured_help(text) if is_coloured(sys.stdout) else text


def coloured_help(text: str) -> str:
    """Returns help with bold headings, and coloured options and commands."""
    text = HEADING.sub(lambda match: click.style(match[0], bold=True), text)
    for pattern in (OPTION, COMMAND):
        text = pattern.sub(lambda match: match[1] + click.style(match[2], fg="cyan"), text)
    return text


def coloured_message(text: str) -> str:
    """Returns an error or a warning with its first words coloured."""
    return PREFIX.sub(lambda match: click.style(match[0], fg=LEVELS[match[2]], bold=True), text)
