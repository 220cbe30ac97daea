"""`mjrun info`."""

import shlex
from typing import TYPE_CHECKING, Any

import click

from mjrun.cli import options, values
from mjrun.cli.column_list import show_columns
from mjrun.cli.console import Console
from mjrun.cli.info_sections import SECTIONS, LineSection
from mjrun.errors import UsageError, clean, option

if TYPE_CHECKING:
    from mjrun.model.info import InfoResult
    from mjrun.model.source import NamedSource

ROWS = 24  # of a section, unless it is asked for


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
            raise UsageError(f"{option('columns')} lists the columns of a trace, which has no sections")
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
    """The sections as text; if they were not asked for by name, long ones are cut, and details are only listed."""
    from mjrun.cli.info_page import Page

    page, command_line, details = Page(), f"mjrun info {clean(shlex.quote(model))}", []
    for name in result.sections:
        section = SECTIONS[name]
        if isinstance(section, LineSection):
            if section.is_detail and not asked:
                details.append(name)
            else:
                page.lines(
                    section.title(result.description) if section.title else name, section.lines(result.description)
                )
            continue

        rows = section.rows(result.description)
        if section.is_detail and not asked:
            details += [f"{name} ({len(rows)})"] if rows else []
        elif asked or section.is_news(rows):
            page.table(name, section.columns(rows), len(rows), None if asked else ROWS, f"{command_line} {name}")

    if details:
        page.note(f"also {', '.join(details)}: {command_line} {details[0].partition(' ')[0]}")
    return page.text()
