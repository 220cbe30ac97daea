"""Options of `mjrun check`."""

import click

from mjrun.cli.options import bundle, option
from mjrun.cli.params import Exact, Jobs, Words

check_options = bundle(
    "Check",
    option(
        "--select",
        type=Words("CODE,…"),
        multiple=True,
        help="Look for these only: MJ301, or MJ3 for all that begin so.",
    ),
    option(
        "--ignore", type=Words("CODE,…"), multiple=True, help="Leave these out. What keeps a model from loading stays."
    ),
    option(
        "--fail-on",
        type=click.Choice(["error", "warning", "note"]),
        default="error",
        show_default=True,
        help="Exit with 1 when something so severe, or more, is found.",
    ),
    option("--list", "list_", is_flag=True, help="List all codes, and stop."),
    option(
        "--steps",
        type=click.IntRange(min=0),
        default=200,
        metavar="N",
        show_default=True,
        help="Steps that a model must live through, from its own start; 0 for none.",
    ),
    option("--timeout", type=Exact("SECONDS"), default="60", show_default=True, help="Wall time for one model."),
    option(
        "--memory",
        type=click.IntRange(min=1),
        default=4096,
        metavar="MIB",
        show_default=True,
        help="Memory for one model.",
    ),
    option("--jobs", type=Jobs(), default="auto", metavar="N|auto", help="Models at once.  [default: one per core]"),
    option("--sarif", is_flag=True, help="One SARIF 2.1.0 document on stdout, for code scanning."),
    option("--github", is_flag=True, help="Annotations of a GitHub workflow on stdout."),
)
