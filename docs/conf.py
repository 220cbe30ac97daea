"""Settings of Sphinx for the site; scripts/make_docs.py writes the pages that it builds."""

from typing import Any, ClassVar

from pygments.lexer import RegexLexer
from pygments.lexers.python import PythonLexer
from pygments.token import Comment, Name, Operator, String, Text
from sphinx.application import Sphinx

from mjrun.cli.main import COMMANDS, command_summary
from mjrun.version import __version__

project = "mjrun"
author = "the mjrun developers"
copyright = f"2026, {author}"  # noqa: A001 - Sphinx's name
release = __version__

extensions = ["myst_parser", "sphinx_copybutton", "sphinx_design"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

highlight_language = "none"
smartquotes_action = "qe"  # no dashes: "--option" stays

html_theme = "furo"
html_title = "mjrun"
html_static_path = ["_static"]
html_copy_source = False
html_use_index = False
html_show_sourcelink = False
html_css_files = ["site.css"]
html_theme_options = {"top_of_page_buttons": []}

# A manual page of each command: its page of the site.
man_pages = [
    ("reference/index", "mjrun", "MuJoCo models to videos, images, tables and timing reports", "", 1),
    *((f"reference/commands/{name}", f"mjrun-{name}", command_summary(name).rstrip("."), "", 1) for name in COMMANDS),
]


class CommandLexer(RegexLexer):
    """Commands of a shell: programs, options and strings, so that site.css can keep an option on one line."""

    name = "Commands"
    aliases: ClassVar[Any] = ["sh"]
    tokens: ClassVar[Any] = {
        "root": [
            (r"#.*", Comment),
            (r"(?<![^\n])[A-Za-z][\w./-]*", Name.Function),
            (r"'[^']*'|\"[^\"]*\"", String),
            (r"\|\||&&|[|;<>]", Operator),
            (r"(?<=\s)--?[A-Za-z][\w-]*", Name.Attribute),
            (r"\s+|[^\s'\"|;<>&]+|.", Text),
        ]
    }


class SnakemakeLexer(PythonLexer):
    """Rules of Snakemake, which are nearly Python."""

    name = "Snakemake"
    aliases: ClassVar[Any] = ["snakemake"]


LEXERS = (CommandLexer, SnakemakeLexer)


def setup(app: Sphinx) -> None:
    """Registers the lexers that Pygments lacks."""
    for lexer in LEXERS:
        app.add_lexer(lexer.aliases[0], lexer)
