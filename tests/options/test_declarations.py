"""Properties of every option of every command, and of single ones as tables."""

import dataclasses
from collections.abc import Mapping
from fractions import Fraction
from functools import partial
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest

import mjrun.options
from mjrun.bench import step_timing
from mjrun.cli.main import COMMANDS, group
from mjrun.errors import BadValueError, UsageError
from mjrun.options.bench import BenchOptions, BenchReportOptions, EngineOptions
from mjrun.options.check import CheckOptions
from mjrun.options.diff import DiffOptions
from mjrun.options.evaluation import EvaluationOptions
from mjrun.options.every_command import ConfinementOptions, ConsoleOptions
from mjrun.options.export import ExportOptions
from mjrun.options.fit import FitOptions
from mjrun.options.model import InfoOptions, ModelOptions
from mjrun.options.option import FrontEnd, OptionRequirement, Options, options_of, requirements_of
from mjrun.options.output import LAST_INSTANT, KeyframeOptions, SimulationCommandOptions
from mjrun.options.plot import FigureOptions, PlotOptions, TablePlotOptions
from mjrun.options.rendering import ViewOptions
from mjrun.options.report import PageOptions
from mjrun.options.run import RunCommandOptions
from mjrun.options.simulation import DRIVERS, PHYSICS, START, SimulationOptions
from mjrun.options.sweep import KeptFileOptions, StudyOptions, VariationOptions
from mjrun.options.task import ActionOptions, ObservationOptions, TaskOptions
from mjrun.options.trace import RecordingOptions, TraceOptions
from mjrun.options.video import PLOT_SIDES, ImageOptions, VideoOptions
from mjrun.options.viewer import ViewerOptions
from mjrun.rendering.live_plot import live_plot_size

SIMULATING = (VideoOptions, ImageOptions, TraceOptions, SimulationOptions, SimulationCommandOptions, ConsoleOptions)
# By name: workers of pytest must collect the classes in the same order.
ALL = {
    (value.__module__, value.__name__): value
    for path in Path(mjrun.options.__file__).parent.glob("*.py")
    for value in vars(import_module(f"mjrun.options.{path.stem}")).values()
    if isinstance(value, type) and issubclass(value, Options) and value is not Options
}
IMAGE = partial(ImageOptions, None, "a.png")
KEYFRAME = partial(KeyframeOptions, None, "a.xml")
TRACE = partial(TraceOptions, None)
PLOT = partial(PlotOptions, None, "a.png", probe="energy")
VIDEO = partial(VideoOptions, None, "a.mp4")
STUDY = partial(StudyOptions, None, "study")
EVALUATION = partial(EvaluationOptions, None, "out")
EVENT = object()
# A value of every option that has no effect without another one, and of those others.
REQUIRING: dict[str, object] = {
    "atol": 1e-3,
    "calibration_format": "ros",
    "camera": ("side",),
    "compare_normalize": "none",
    "depth_range": (0, 1),
    "design": "zip",
    "embed_up_to": 1,
    "excite_noise": 1e-2,
    "fps": 60,
    "include": "a.png",
    "keep_highest": "1:drift",
    "keep_lowest": "1:drift",
    "keep_where": "drift > 1",
    "normalize": "none",
    "plot_side": "beside",
    "polygons": True,
    "probe": "qpos",
    "quality": "draft",
    "rtol": 1e-3,
    "sampler": "lhs",
    "samples": 8,
    "seg_by": "body",
    "size": (64, 48),
    "slurm": "time=2h",
    "speed": 2,
    "text_corner": "top",
    "tol": {"time": 1},
    "trail_span": 1,
    "update": True,
    "velocity_limit": 1,
    "yolo_task": "segment",
}
PARTNERS: dict[str, object] = {
    "calibration": "c.json",
    "compare": "random",
    "contact_sheet": "a.mp4",
    "engine": "slurm",
    "excite": "a.csv",
    "format": ["coco", "yolo"],
    "golden": "g.csv",
    "html": "a.html",
    "keep": ["trace", "video"],
    "plot": "energy",
    "policy": "zero",
    "text": "{time}",
    "trail": "ball",
    "vary": (("mass", "uniform(0, 1)"), ("a", "1,2"), ("b", "3,4")),
    "video": "a.mp4",
    "videos": 3,
    "view": ["rgb", "depth", "seg"],
}
REQUIREMENTS = [
    pytest.param(cls, each, id=f"{cls.__name__}-{each.name}")
    for cls in (ALL[name] for name in sorted(ALL))
    for each in requirements_of(cls)
]


# A value of every option that a replay may exclude.
REPLAY_EXCLUDES = {
    "key": "home",
    "qpos": {"hip": 1},
    "qvel": {"hip": 1},
    "ctrl": {"motor": 1},
    "ctrl_from": "a.csv",
    "ctrl_noise": 0.1,
    "controller": print,
    "push": "torso=1/0/0@0+1",
    "perturb": 0.1,
}


@pytest.mark.parametrize("cls", [ALL[name] for name in sorted(ALL)], ids=lambda cls: cls.__name__)
def test_a_default_is_a_value_of_its_kind_and_help_has_single_spaces(cls: type[Options]) -> None:
    for each in options_of(cls):
        assert "  " not in each.help, each.name
        assert each.is_required or each.default is None or each.kind(each.default) == each.default, each.name


def test_a_name_means_the_same_in_every_command_that_simulates() -> None:
    meanings: dict[str, tuple[object, str]] = {}
    for cls in SIMULATING:
        for each in options_of(cls):
            if each.name not in ("output", "format"):  # which depend on what is made
                kind, text = meanings.setdefault(each.name, (each.kind, each.help))
                assert (kind, text) == (each.kind, each.help), each.name


@pytest.mark.parametrize(
    ("cls", "places"),
    [
        (SimulationCommandOptions, FrontEnd.COMMAND),
        (ConfinementOptions, FrontEnd.COMMAND),
        (ConsoleOptions, FrontEnd.COMMAND),
        (InfoOptions, FrontEnd.COMMAND),
        (RunCommandOptions, FrontEnd.COMMAND | FrontEnd.PYTHON),
        (ViewerOptions, FrontEnd.COMMAND | FrontEnd.PYTHON),
    ],
)
def test_no_document_sets_what_belongs_to_this_machine(cls: type[Options], places: FrontEnd) -> None:
    assert all(each.places in places for each in options_of(cls))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_the_options_of_the_console_off_by_default(name: str) -> None:
    command = group.get_command(click.Context(group), name)
    assert command
    assert {param.name for param in command.params} >= {"json", "quiet", "verbose", "debug"}
    assert not any(each.default for each in options_of(ConsoleOptions))


@pytest.mark.parametrize(
    ("make", "values", "message"),
    [
        (BenchReportOptions, {"csv": True, "markdown": True}, "csv and markdown exclude each other"),
        (IMAGE, {"time": 1, "step": 2}, "time and step exclude each other: both set the instant"),
        (KEYFRAME, {"time": 1, "step": 3}, "time and step exclude each other: both set the instant"),
        (TRACE, {"every": 2, "rate": 100}, "every and rate exclude each other: both set the sampling rate"),
        (PLOT, {"every": 2, "rate": 100}, "every and rate exclude each other: both set the sampling rate"),
        (VIDEO, {"plot": "energy", "separate": True}, "plot and separate exclude each other"),
        (SimulationOptions, {"duration": 1, "steps": 2}, "duration and steps exclude each other: both set the length"),
        (SimulationOptions, {"controller": print, "ctrl_from": "a.csv"}, "controller and ctrl_from exclude each other"),
    ],
)
def test_options_that_exclude_each_other_are_refused(make: Any, values: Mapping[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=f"^{message}"):
        make(**values)


@pytest.mark.parametrize(("cls", "requirement"), REQUIREMENTS)
def test_an_option_without_effect_is_refused_unless_its_partner_is_given(
    cls: type[Options], requirement: OptionRequirement
) -> None:
    needed = {
        each.name: "a"
        for each in dataclasses.fields(cls)  # type: ignore[arg-type]
        if each.default is each.default_factory is dataclasses.MISSING
    }
    alone = {requirement.name: REQUIRING[requirement.name]}
    with pytest.raises(UsageError, match=f"^{requirement.name} requires {requirement.partner}\\b") as error:
        cls(**needed, **alone)
    assert error.value.path == (requirement.name,)
    assert [path for path, _ in cls.unmet_requirements(alone)] == [(requirement.name,)]

    for partner in (requirement.partner, *requirement.alternatives):
        together = {**alone, partner: PARTNERS[partner]}
        cls(**needed, **together)
        assert not [*cls.unmet_requirements(together)]


def test_requirements_are_those_of_single_values_too() -> None:
    (by_view,) = (each for each in requirements_of(ViewOptions) if each.name == "depth_range")
    assert by_view.is_met({"view": "depth"})
    assert not any(by_view.is_met({"view": value}) for value in (None, "seg", ["rgb"], 5, [[]]))
    VIDEO(plot_side="under", seg_by="object")  # the defaults


@pytest.mark.parametrize(
    ("make", "name", "value", "expected"),
    [
        (BenchOptions, "threads", ["1,2", "auto"], (1, 2, "auto")),
        (BenchOptions, "size", (64, 48), ((64, 48),)),
        (BenchOptions, "fail_above", 0.1, 0.1),
        (BenchOptions, "scan", {"opt.gravity": [[0, 0, -1], [0, 0, -2]]}, (("opt.gravity", "0,0,-1;0,0,-2"),)),
        (BenchOptions, "scan", {"timestep": [0.001, 0.002]}, (("timestep", "0.001,0.002"),)),
        (BenchOptions, "budget", "1/3", Fraction(1, 3)),
        (CheckOptions, "select", "MJ1, MJ301", ("MJ1", "MJ301")),
        (ConfinementOptions, "limit", {"time": 60, "memory": 512}, {"time": (60.0,), "memory": (512.0,)}),
        (DiffOptions, "columns", "q*", ("q*",)),
        (EVALUATION, "fail_below", {"success": 0.9}, {"success": (0.9,)}),
        (partial(ExportOptions, None, "a.glb"), "fps", "30000/1001", Fraction(30000, 1001)),
        (FigureOptions, "y", ["max(a, b), c", "d"], ("max(a, b), c", "d")),
        (FigureOptions, "y", "qpos", ("qpos",)),
        (FigureOptions, "log", "x,2:y", ("x", "2:y")),
        (FigureOptions, "mark", "m·g=87.356", ("m·g=87.356",)),
        (FigureOptions, "mark_event", "contact(a, b)", ("contact(a, b)",)),
        (FitOptions, "free", {"joint/a.damping": "0..1"}, (("joint/a.damping", "0..1"),)),
        (IMAGE, "time", 0.1, Fraction(1, 10)),
        (IMAGE, "time", 0, 0),
        (IMAGE, "time", EVENT, EVENT),
        (KeptFileOptions, "keep", "trace,video", ("trace", "video")),
        (KeptFileOptions, "keep", ("recording",), ("recording",)),
        (KEYFRAME, "manifest", Path("a.json"), "a.json"),
        (ModelOptions, "timestep", 0.1, Fraction(1, 10)),
        (ModelOptions, "timestep", "1/480", Fraction(1, 480)),
        (partial(ObservationOptions, name="angles"), "joints", "knee", ("knee",)),
        (partial(ObservationOptions, name="angles"), "scale", 2, (2.0,)),
        (partial(ObservationOptions, name="angles"), "phase", "0.5", Fraction(1, 2)),
        (partial(PlotOptions, None, "a.png"), "probe", ["qpos,qvel", "energy"], ("qpos,qvel", "energy")),
        (partial(PageOptions, html="a.html"), "embed_up_to", 0, 0),
        (SimulationOptions, "duration", 0.1, Fraction(1, 10)),
        (SimulationOptions, "key", 2, "2"),
        (SimulationOptions, "qpos", {"hip": 0.3, "root": np.arange(3.0)}, {"hip": (0.3,), "root": (0, 1, 2)}),
        (STUDY, "metric", {"drift": "max(x)", "up": "share(x >= 1)"}, (("drift", "max(x)"), ("up", "share(x >= 1)"))),
        (partial(TaskOptions, duration="5"), "control_dt", 0.02, Fraction(1, 50)),
        (VariationOptions, "vary", {"a": [0.1, 2], "seed": "1..3:3"}, (("a", "0.1,2"), ("seed", "1..3:3"))),
        (TRACE, "probe", "qpos, xpos[hand, foot],energy", ("qpos", "xpos[hand, foot]", "energy")),
        (TRACE, "probe", ["qpos,xpos[hand, foot]", "energy"], ("qpos", "xpos[hand, foot]", "energy")),
        (VIDEO, "fps", "30000/1001", Fraction(30000, 1001)),
        (VIDEO, "jobs", 1, 1),
        (VIDEO, "jobs", "auto", "auto"),
        (VIDEO, "preset", 8, "8"),  # as AV1 numbers them
        (ViewerOptions, "speed", "1/3", Fraction(1, 3)),
    ],
)
def test_values_become_exact_and_immutable(make: Any, name: str, value: object, expected: object) -> None:
    assert getattr(make(**{name: value}), name) == expected


@pytest.mark.parametrize(
    ("make", "name", "value", "message"),
    [
        (partial(ActionOptions, joints="knee"), "target", "push", "position"),
        (BenchOptions, "threads", "1,many", "^threads: 'many' is not a number of threads, at least 1, or auto"),
        (CheckOptions, "memory", 0, "^memory: '0' is not a whole number of at least 1"),
        (DiffOptions, "atol", -1, "atol"),
        (DiffOptions, "rtol", float("nan"), "rtol"),
        (DiffOptions, "min_ssim", 2, "min_ssim"),
        (DiffOptions, "max_changed", 1.5, "max_changed"),
        (DiffOptions, "tol", {"x": [1, 2, 3]}, "tol: .* is not an absolute tolerance"),
        (EVALUATION, "fail_below", {"success": (0.9, 1)}, "fail_below"),
        (EVALUATION, "episodes", 0, "episodes"),
        (EVALUATION, "confidence", 0, "confidence"),
        (EVALUATION, "confidence", 1, "confidence"),
        (EVALUATION, "videos", -1, "videos"),
        (FigureOptions, "style", "pink", "style"),
        (FigureOptions, "columns", 0, "columns"),
        (FigureOptions, "columns", 9, "columns"),
        (FigureOptions, "size", (0, 5), "size"),
        (FigureOptions, "log", "", "log"),
        (FitOptions, "holdout", 1.0, "holdout"),
        (FitOptions, "confidence", 0.2, "confidence"),
        (FitOptions, "starts", 0, "starts"),
        (FitOptions, "loss", "l2", "loss"),
        (IMAGE, "time", -1, "^time: '-1' is not a number of at least 0"),
        (IMAGE, "legend", 1, "^legend: '1' is not true or false"),
        (KeptFileOptions, "keep", "movie", "trace, recording, video"),
        (PageOptions, "embed_up_to", -1, "embed_up_to"),
        *(
            (SimulationOptions, "duration", value, "^duration: .* is not a positive number")
            for value in (0, -1, float("nan"), float("inf"), "long")
        ),
        (TRACE, "probe", ["qpos", ""], "^probe: .* is not the name of something to measure"),
        (TRACE, "probe", ["qpos", " , "], "^probe: .* is not the name of something to measure"),
        (VariationOptions, "samples", 0, "samples"),
        (VariationOptions, "design", "star", "design"),
        (VariationOptions, "sampler", "dice", "sampler"),
        (VariationOptions, "repeats", 0, "repeats"),
        (VIDEO, "speed", 0, "^speed: '0' is not a positive number"),
        (VIDEO, "jobs", 0, "^jobs: '0' is not a number of processes, at least 1, or auto"),
        (ViewerOptions, "speed", 0, "speed"),
        (ViewerOptions, "port", 0, "port"),
        (ViewerOptions, "port", 70000, "port"),
        (ViewerOptions, "browser", "firefox", "browser"),
    ],
)
def test_invalid_values_are_refused(make: Any, name: str, value: object, message: str) -> None:
    with pytest.raises(BadValueError, match=message):
        make(**{name: value})


@pytest.mark.parametrize(
    ("cls", "names"),
    [
        (KeyframeOptions, {"output", "name", "time", "step", "manifest"}),
        (RecordingOptions, {"output", "keep_partial", "manifest"}),
        (EngineOptions, {"engine", *signature(step_timing.WarpSettings).parameters}),
        (InfoOptions, {"columns", "xml"}),
    ],
)
def test_classes_have_these_options_and_no_others(cls: type[Options], names: set[str]) -> None:
    assert {each.name for each in options_of(cls)} == names


@pytest.mark.parametrize(
    ("cls", "like", "names"),
    [
        (BenchOptions, ViewOptions, {"size", "camera", "view", "quality", "renderer", "gl"}),
        (RunCommandOptions, VideoOptions, {"quality", "jobs"}),
        (PlotOptions, FigureOptions, {each.name for each in options_of(FigureOptions)}),
        (TablePlotOptions, FigureOptions, {each.name for each in options_of(FigureOptions)}),
    ],
)
def test_commands_share_the_forms_of_values(cls: type[Options], like: type[Options], names: set[str]) -> None:
    metavars = {each.name: each.kind.metavar for each in options_of(cls)}
    assert {name: metavars[name] for name in names} == {
        each.name: each.kind.metavar for each in options_of(like) if each.name in names
    }


def test_left_out_options_of_run_change_nothing() -> None:
    options = RunCommandOptions()
    assert (options.output, options.quality, options.jobs, options.gl, options.controller) == (".", *[None] * 4)
    assert KEYFRAME().name == LAST_INSTANT
    assert ViewerOptions().browser is None


def test_a_plot_under_a_frame_is_as_wide_and_one_beside_it_as_high() -> None:
    under, beside = (live_plot_size((640, 480), side) for side in PLOT_SIDES)
    assert (under[0], beside[1]) == (640, 480)


def test_what_a_replay_excludes_is_known() -> None:
    assert {*DRIVERS, *PHYSICS, *START} == set(REPLAY_EXCLUDES) <= {each.name for each in options_of(SimulationOptions)}


@pytest.mark.parametrize("name", [*DRIVERS, *PHYSICS])
def test_a_replay_of_states_has_no_physics(name: str) -> None:
    with pytest.raises(UsageError, match=f"^replay and {name} exclude each other") as error:
        SimulationOptions(replay="a.npz", **{name: REPLAY_EXCLUDES[name]})  # type: ignore[arg-type]
    assert error.value.path == (name,)
    assert SimulationOptions(**{name: REPLAY_EXCLUDES[name]}).replay is None  # type: ignore[arg-type]


@pytest.mark.parametrize("name", REPLAY_EXCLUDES)
def test_a_replay_of_controls_has_physics_and_no_other_driver(name: str) -> None:
    given = {"replay": "a.npz", "replay_mode": "controls", name: REPLAY_EXCLUDES[name]}
    if name not in DRIVERS:
        SimulationOptions(**given)  # type: ignore[arg-type]
        return
    with pytest.raises(UsageError, match=f"^replay and {name} exclude each other: the replayed file drives"):
        SimulationOptions(**given)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", START)
def test_a_table_may_lack_what_the_start_says(name: str) -> None:
    SimulationOptions(replay="a.csv", **{name: REPLAY_EXCLUDES[name]})  # type: ignore[arg-type]
