"""Describe a model: sizes, bodies, joints, actuators, sensors, assets."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import MODEL, ParsedCommandLine, command
from mjrun.cli.console import CommandReport, Console
from mjrun.cli.info_sections import ROWS, SECTIONS, LineSection, demonstrations_page, task_page
from mjrun.cli.simulation_command import import_mujoco, show_columns, source
from mjrun.cli.table_cells import ReportColumn
from mjrun.errors import UsageError, clean, option
from mjrun.options.every_command import ConfinementOptions
from mjrun.options.model import InfoOptions, ServoOptions
from mjrun.suffixes import is_hdf5

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mjrun.model.info import InfoResult
    from mjrun.model.source import CollectionModelSource, ModelSource

ENVIRONMENT = "gym:"  # prefix of sources that are also tasks
TASK_SECTIONS = ("task", "observations", "actions", "rewards", "terminations")  # of an environment
SECTION_ARGUMENT = click.Argument(["sections"], metavar="[SECTION]...", nargs=-1)


@command(
    InfoOptions,
    ServoOptions,
    ConfinementOptions,
    arguments=[MODEL, SECTION_ARGUMENT],
    reports={
        "info": "mjrun.model.info:InfoResult",
        "info-task": "mjrun.task.description:TaskDescription",
        "info-demos": "mjrun.hdf5.demonstration_list:DemonstrationList",
    },
)
def info(console: Console, command_line: ParsedCommandLine) -> None:
    """Describe MODEL: sizes, bodies, joints, actuators, sensors and more; or only the given SECTIONs, in full.

    For a task document, describes the observations and actions of the policy, number by number, and the course of
    episodes. Sections of a task also work for an environment such as gym:Ant-v5. For a file of demonstrations in HDF5,
    lists them.

    \b
    mjrun info scene.xml
    mjrun info scene.xml joints actuators
    mjrun info scene.xml --json | jq .summary.mass
    mjrun info scene:
    mjrun info gym:
    mjrun info task.yaml observations
    mjrun info gym:Ant-v5 observations
    mjrun info demo.hdf5
    mjrun info demo.hdf5:demo_3

    Sections: summary, bodies, joints, geoms, sites, actuators, sensors, cameras, lights, keyframes, tendons,
    equalities, pairs, excludes, flexes, plugins, options, visual, statistics, assets. Sections of a task: task,
    observations, actions, commands, rewards, terminations, reset.
    """
    import_mujoco()
    sections, options = command_line.arguments("sections"), command_line.make(InfoOptions)
    if options.xml:
        _print_xml(console, source(command_line))
        return
    if options.columns:
        if sections:
            raise UsageError(f"{option('columns')} lists the columns of a trace, and has no sections")
        show_columns(console, source(command_line))
        return
    from mjrun.model.info import Info, InfoResult
    from mjrun.model.sources import is_task_name, listed_collection

    model = command_line.argument("model")
    if is_task_name(model) or (sections and model.startswith(ENVIRONMENT) and set(sections) <= {*TASK_SECTIONS}):
        _show_task(console, command_line, sections)
        return
    if not sections and (collection := listed_collection(model)):
        _show_collection(console, collection)
        return
    if not sections and is_hdf5(model):
        _show_demonstrations(console, model)
        return
    result = Info(source(command_line), sections).run(console)
    report = CommandReport("info", result, lambda: _page(result, bool(sections), model), document=InfoResult.document)
    console.answer(report)


def _show_task(console: Console, command_line: ParsedCommandLine, sections: "Sequence[str]") -> None:
    """Prints a task, or sections of it."""
    from mjrun.model.sources.gym import GymSource
    from mjrun.task.description import describe_environment, describe_task
    from mjrun.task.task import Task

    task = source(command_line)
    assert isinstance(task, Task | GymSource)
    description = describe_environment(task) if isinstance(task, GymSource) else describe_task(task)
    document = description.document(*sections)
    again = f"mjrun info {clean(shlex.quote(task.text))}"
    console.answer(
        CommandReport(
            "info-task",
            description,
            lambda: task_page(description, list(document) if sections else (), again),
            document=lambda _: document,
        )
    )


def _print_xml(console: Console, model: "ModelSource") -> None:
    """Prints the MJCF within a demonstration."""
    from mjrun.model.sources.demonstration import DemonstrationSource

    if not isinstance(model, DemonstrationSource):
        raise UsageError(f"{option('xml')} applies only to demonstrations, as in demo.hdf5:demo_3")
    console.result(model.mjcf().rstrip("\n"))


def _show_demonstrations(console: Console, file: str) -> None:
    """Lists the demonstrations in a file."""
    from mjrun.model.sources.demonstration import list_demonstrations

    listed = list_demonstrations(Path(file))
    console.answer(CommandReport("info-demos", listed, lambda: demonstrations_page(listed)))


def _show_collection(console: Console, collection: "type[CollectionModelSource]") -> None:
    """Lists a collection of models, such as the scenes of mjrun, one per line."""
    entries = {f"{collection.PREFIX}:{entry.name}": entry.facts for entry in collection.entries()}
    if console.document_form:
        console.document({"models": [{"name": name, **facts} for name, facts in entries.items()]})
        return
    if not entries:
        console.result(f"no {collection.KIND}s")
        return
    headings = list(next(iter(entries.values())))
    if len(headings) > 1:
        _show_table(console, collection, entries, headings)
        return
    width = max(map(len, entries), default=0)
    for name, facts in entries.items():
        console.result(clean(f"{name:{width}}  {' '.join(facts.values())}"))


def _show_table(
    console: Console,
    collection: "type[CollectionModelSource]",
    entries: "Mapping[str, Mapping[str, str]]",
    headings: "Sequence[str]",
) -> None:
    from mjrun.cli.terminal_layout import TerminalReport

    page = TerminalReport()
    cells = [[clean(facts[heading]) for facts in entries.values()] for heading in headings]
    columns = [ReportColumn("name", [clean(name) for name in entries], whole=True)]
    for heading, texts in zip(headings, cells, strict=True):
        columns.append(ReportColumn(heading, texts, right=all(text.isdecimal() for text in texts if text)))
    page.table(f"{collection.PREFIX}:", columns, len(entries))
    if remark := collection.remark():
        page.note(remark)
    console.result(page.text())


def _page(result: "InfoResult", asked: bool, model: str) -> str:
    """Formats the sections as text; without names, long sections are cut and details only listed."""
    from mjrun.cli.terminal_layout import TerminalReport

    page, command_line = TerminalReport(), f"mjrun info {clean(shlex.quote(model))}"
    details: list[str] = []
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

        rows = result.description.section(name)
        if section.is_detail and not asked:
            details += [f"{name} ({len(rows)})"] if rows else []
        elif asked or section.is_news(rows):
            page.table(
                name,
                section.columns(rows, result.description.model),
                len(rows),
                None if asked else ROWS,
                f"{command_line} {name}",
            )

    if details:
        page.note(f"also {', '.join(details)}: {command_line} {details[0].partition(' ')[0]}")
    if model.startswith(ENVIRONMENT) and not asked:
        page.note(f"as a task: {command_line} {' '.join(TASK_SECTIONS)}")
    return page.text()
