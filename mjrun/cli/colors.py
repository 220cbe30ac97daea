"""Colours of help and of messages, on terminals that want them."""

import os
import re
import sys
from typing import TextIO

import click

HEADING = re.compile(r"^(Usage:|\S.*:$)", re.MULTILINE)
OPTION = re.compile(r"^(  )((?:-\w, )?--?[\w-]+(?:, ?--?[\w-]+|/--?[\w-]+)*)", re.MULTILINE)
COMMAND = re.compile(r"^(  )([a-z]+)(?=  )", re.MULTILINE)
PREFIX = re.compile(r"^(mjrun: )(error|warning)(:)")
LEVELS = {"error": "red", "warning": "yellow"}


def is_coloured(stream: TextIO) -> bool:
    """Returns whether a stream is a terminal that shows colours: see no-color.org."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


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
