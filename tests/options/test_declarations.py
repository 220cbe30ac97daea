"""What holds for every option of every command."""

import re
from importlib import import_module
from pathlib import Path

import pytest

import mjrun.options
from mjrun.options.bench import BenchOptions, ReportOptions
from mjrun.options.check import CheckOptions, CheckReportOptions
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.console import ConsoleOptions
from mjrun.options.diff import DiffOptions, DiffReportOptions
from mjrun.options.evaluation import EvaluationCommandOptions, EvaluationExecutionOptions, EvaluationOptions
from mjrun.options.fit import FitOptions
from mjrun.options.image import ImageOptions
from mjrun.options.info import InfoOptions
from mjrun.options.keyframe import KeyframeOptions
from mjrun.options.option import Option, Options, options_of
from mjrun.options.output import CommandOptions
from mjrun.options.plot import PlotOptions, TablePlotOptions
from mjrun.options.policy import PolicyOptions
from mjrun.options.run import RunOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.sweep import ExecutionOptions, StudyCommandOptions, StudyOptions
from mjrun.options.task import (
    ActionOptions,
    ObservationOptions,
    ResetOptions,
    RewardOptions,
    TaskOptions,
    TerminationOptions,
)
from mjrun.options.task import (
    CommandOptions as TaskCommandOptions,
)
from mjrun.options.trace import RecordingOptions, TraceCommandLineOptions, TraceOptions
from mjrun.options.video import VideoOptions
from mjrun.options.viewer import ViewerOptions

SIMULATING = (VideoOptions, ImageOptions, TraceOptions, SimulationOptions, CommandOptions, ConsoleOptions)
ALL: tuple[type[Options], ...] = (
    *SIMULATING,
    TraceCommandLineOptions,
    PlotOptions,
    TablePlotOptions,
    PolicyOptions,
    ConfinementOptions,
    TaskOptions,
    ResetOptions,
    ObservationOptions,
    ActionOptions,
    TaskCommandOptions,
    RewardOptions,
    TerminationOptions,
    RecordingOptions,
    KeyframeOptions,
    RunOptions,
    BenchOptions,
    ReportOptions,
    CheckOptions,
    CheckReportOptions,
    DiffOptions,
    FitOptions,
    DiffReportOptions,
    EvaluationOptions,
    EvaluationExecutionOptions,
    EvaluationCommandOptions,
    InfoOptions,
    StudyOptions,
    StudyCommandOptions,
    ExecutionOptions,
    ViewerOptions,
)
DECLARED = [pytest.param(each, id=f"{cls.__name__}.{each.name}") for cls in ALL for each in options_of(cls)]


@pytest.mark.parametrize("each", DECLARED)
def test_help_is_a_sentence_that_spells_no_other_way_than_its_front_end(each: Option) -> None:
    assert re.match(r"^[A-Z*{]|^[a-z0-9]+[,:]", each.help), each.help
    assert each.help.endswith((".", "…", "'"))
    assert "  " not in each.help


@pytest.mark.parametrize("each", DECLARED)
def test_a_default_is_a_value_of_its_kind(each: Option) -> None:
    if not each.is_required:
        assert each.kind(each.default) == each.default


def test_a_name_means_the_same_in_every_command_that_simulates() -> None:
    meanings: dict[str, tuple[object, str]] = {}
    for cls in SIMULATING:
        for each in options_of(cls):
            if each.name not in ("output", "format"):  # which depend on what is made
                kind, text = meanings.setdefault(each.name, (each.kind, each.help))
                assert (kind, text) == (each.kind, each.help), each.name


def test_every_module_of_options_is_covered_here() -> None:
    folder = Path(mjrun.options.__file__).parent
    modules = {path.stem for path in folder.glob("*.py")} - {
        "__init__",
        "kinds",
        "option",
        "push",
        "variations",
        "schema",
        "record",
    }
    bases = {base.__module__ for cls in ALL for base in cls.__mro__}
    assert {f"mjrun.options.{name}" for name in modules} <= bases
    for name in modules:
        classes = [value for value in vars(import_module(f"mjrun.options.{name}")).values() if isinstance(value, type)]
        assert any(issubclass(cls, Options) for cls in classes)
