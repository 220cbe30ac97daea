"""The page of `mjrun info` about a task: the vectors of observations and actions, number by number, and the rest."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from mjrun.cli.table_cells import ReportColumn, number, numbers, ranges, texts
from mjrun.cli.terminal_layout import TerminalReport
from mjrun.errors import clean, counted

if TYPE_CHECKING:
    from mjrun.task.description import TaskDescription, TaskSummary

ROWS = 24  # of a section, unless it is requested


def task_page(task: "TaskDescription", sections: Sequence[str], command_line: str) -> str:
    """Formats the sections as text; without names, all sections, with long ones cut."""
    page = TerminalReport()
    for name in sections or ("task", *TABLES):
        if name == "task":
            page.lines("task", _summary(task.task))
            continue
        columns = TABLES[name](task)
        count = len(columns[0].cells)
        if count or sections:
            page.table(name, columns, count, None if sections else ROWS, f"{command_line} {name}")
    return page.text()


def _summary(task: "TaskSummary") -> list[tuple[str, str]]:
    steps = f"{counted(task.control_steps, 'step')} of {number(task.timestep)} s"
    return [
        ("model", clean(task.model)),
        ("control period", f"{number(task.control_dt)} s, {steps}"),
        ("episode", _length(task)),
        ("derived quantities", task.derived),
        ("policy", f"{task.observations} numbers in, {task.actions} out"),
    ]


def _length(task: "TaskSummary") -> str:
    if task.duration is None or task.periods is None:
        return "no limit"
    return f"{number(task.duration)} s, {counted(task.periods, 'control period')}"


def _observations(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.observations
    return [
        ReportColumn("index", [str(row.index) for row in rows], right=True),
        texts("name", [row.name for row in rows]),
        texts("source", [row.source for row in rows]),
        texts("unit", [row.unit for row in rows]),
        numbers("offset", [row.offset for row in rows]),
        numbers("scale", [row.scale for row in rows], usual=1),
        ranges("clip", [_limits(row.low, row.high) for row in rows]),
        texts("frame", [row.frame for row in rows]),
        texts("noise", [row.noise for row in rows]),
        numbers("delay", [row.delay for row in rows], "periods"),
    ]


def _actions(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.actions
    return [
        ReportColumn("index", [str(row.index) for row in rows], right=True),
        texts("name", [row.name for row in rows]),
        texts("target", [row.target for row in rows]),
        texts("unit", [row.unit for row in rows]),
        texts("squash", ["" if row.squash == "none" else row.squash for row in rows]),
        ranges("clip", [_limits(row.low, row.high) for row in rows]),
        numbers("scale", [row.scale for row in rows], usual=1),
        numbers("offset", [row.offset for row in rows]),
        numbers("kp", [row.kp for row in rows]),
        numbers("kd", [row.kd for row in rows]),
        numbers("delay", [row.delay for row in rows], "periods"),
        texts("actuator", ["" if row.actuator == row.name else row.actuator for row in rows]),
        ranges("ctrlrange", [row.range for row in rows]),
    ]


def _commands(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.commands
    return [
        texts("name", [row.name for row in rows]),
        ReportColumn("numbers", [str(row.size) for row in rows], right=True),
        texts("source", [row.source for row in rows]),
    ]


def _rewards(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.rewards
    return [
        texts("name", [row.name for row in rows]),
        numbers("weight", [row.weight for row in rows], usual=1),
        texts("value", [row.value for row in rows]),
    ]


def _terminations(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.terminations
    return [
        texts("name", [row.name for row in rows]),
        texts("ends in", [row.kind for row in rows]),
        texts("when", [row.when for row in rows]),
    ]


def _reset(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.reset
    return [
        texts("", [row.what for row in rows]),
        texts("name", [row.name for row in rows]),
        texts("value", [row.value for row in rows]),
    ]


def _limits(low: float | None, high: float | None) -> tuple[float, float] | None:
    if low is None and high is None:
        return None
    return -math.inf if low is None else low, math.inf if high is None else high


TABLES: "Mapping[str, Callable[[TaskDescription], list[ReportColumn]]]" = {
    "observations": _observations,
    "actions": _actions,
    "commands": _commands,
    "rewards": _rewards,
    "terminations": _terminations,
    "reset": _reset,
}
