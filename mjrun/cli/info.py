"""`mjrun info`."""

import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from mjrun.cli import options, values
from mjrun.cli.column_list import show_columns
from mjrun.cli.console import Console
from mjrun.cli.info_summary import LINES
from mjrun.cli.info_tables import TABLES
from mjrun.errors import UsageError, clean

if TYPE_CHECKING:
    from mjrun.model.info import InfoResult
    from mjrun.model.source import NamedSource

DETAILS = ("geoms", "sites", "lights", "visual", "statistics")  # shown only when asked for
ROWS = 24  # of one section that are shown when it is not asked for


@click.command("info", cls=options.SectionedCommand)
@options.model_argument
@click.argument("sections", metavar="[SECTION]...", nargs=-1)
@click.option("--columns", is_flag=True, help="List every column that a trace of the model can have, and stop.")
@options.model_options
@options.output_options
@click.pass_obj
def command(console: Console, /, as_json: bool, **given: Any) -> None:
    """Show what MODEL is: sizes, bodies, joints, actuators, sensors and all else, or only each SECTION, whole.

    \b
    mjrun info scene.xml
    mjrun info scene.xml joints actuators
    mjrun info scene.xml --json | jq .summary.mass
    mjrun info scene:

    Sections: summary, bodies, joints, geoms, sites, actuators, sensors, cameras, lights, keyframes, tendons,
    equalities, pairs, excludes, flexes, plugins, options, visual, statistics, assets.
    """
    console.guard_stdout()
    values.import_mujoco()
    if given["columns"]:
        if given["sections"]:
            raise UsageError("--columns lists the columns of a trace, and has no sections")
        show_columns(console, values.source(given), as_json)
        return
    from mjrun.model.info import Info
    from mjrun.model.sources import listed_collection

    if not given["sections"] and (collection := listed_collection(given["model"])):
        _show_collection(console, collection, as_json)
        return
    result = Info(values.source(given), given["sections"]).run(console)
    if as_json:
        console.document(result.document())
    else:
        console.result(_page(result, bool(given["sections"]), given["model"]))


def _show_collection(console: Console, collection: "type[NamedSource]", as_json: bool) -> None:
    """Lists a collection of models, such as our scenes, a line each."""
    models = {f"{collection.PREFIX}:{name}": text for name, text in collection.descriptions().items()}
    if as_json:
        console.document({"models": [{"name": name, "description": text} for name, text in models.items()]})
        return
    width = max(map(len, models), default=0)
    for name, text in models.items():
        console.result(clean(f"{name:{width}}  {text}"))


def _page(result: "InfoResult", asked: bool, model: str) -> str:
    """All that was found as text; when no section was asked for, long ones are cut, and details only named."""
    from mjrun.cli.info_layout import Page

    page, again = Page(), f"mjrun info {clean(shlex.quote(model))}"
    details = []
    for name in result.sections:
        found = getattr(result.description, name)
        if not asked and name in DETAILS:
            details += [f"{name} ({len(found)})" if isinstance(found, tuple) else name] if found else []
        elif name in LINES:
            page.lines(*_titled(name, found))
        elif asked or _is_news(name, found):
            page.table(name, TABLES[name](found), len(found), None if asked else ROWS, f"{again} {name}")
    if details:
        page.note(f"also {', '.join(details)}: {again} {details[0].partition(' ')[0]}")
    return page.text()


def _titled(name: str, found: Any) -> tuple[str, list[tuple[str, str]]]:
    return (clean(found.name) if name == "summary" else name), LINES[name](found)


def _is_news(name: str, found: Sequence[Any]) -> bool:
    """Whether a section has something in it, that the summary has not told."""
    return any(asset.path and asset.kind != "model" for asset in found) if name == "assets" else bool(found)
