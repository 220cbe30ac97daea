"""Choices and examples of options are those that the layers below implement, and names in help are MuJoCo's."""

import math
import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import mujoco
import pytest

from mjrun.bench import step_timing
from mjrun.camera.script import parse_camera
from mjrun.check import finding
from mjrun.check.rule_runner import RULES
from mjrun.cli import report_formats
from mjrun.cli.report_formats import CiVerdict
from mjrun.errors import BadValueError, UnknownNameError
from mjrun.formats import calibration_writer, image_format
from mjrun.formats.codecs import CODECS
from mjrun.model.names import enum_members
from mjrun.model.override import overrides_of
from mjrun.model.sources import load, parse_source
from mjrun.options.bench import ENGINES
from mjrun.options.check import SEVERITIES, CheckOptions
from mjrun.options.datasets import EPISODE_FORMATS
from mjrun.options.export import ExportOptions
from mjrun.options.model import INTEGRATORS, ModelOptions
from mjrun.options.option import options_of
from mjrun.options.output import CODECS as CODEC_LIST
from mjrun.options.output import KeyframeOptions, OutputOptions
from mjrun.options.plot import PlotOptions
from mjrun.options.policy import PolicyOptions
from mjrun.options.rendering import (
    BACKENDS,
    CALIBRATION_FORMATS,
    CORNERS,
    LAYOUTS,
    QUALITIES,
    RENDERERS,
    RIG_EXAMPLES,
    STYLES,
    VIEWS,
    ImageContentOptions,
    ViewOptions,
)
from mjrun.options.report import REPORT_FORMATS
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.sweep import EXTRAS, ExecutionOptions, StudyCommandOptions
from mjrun.options.trace import PROBES, RecordingOptions, TraceOptions
from mjrun.options.video import ImageOptions, VideoOptions
from mjrun.outputs.format_lists import LISTS, with_formats
from mjrun.probe.select import select
from mjrun.rendering import backend, text
from mjrun.rendering.compositor import RENDERERS as IMPLEMENTED_RENDERERS
from mjrun.rendering.compositor import columns
from mjrun.rendering.visual import GROUPS, Visual, flags, frame_axes, groupings, labels
from mjrun.study import executors

OUTPUTS = (VideoOptions, ImageOptions, TraceOptions, PlotOptions, RecordingOptions, KeyframeOptions, ExportOptions)
MODEL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="box"><freejoint/><geom name="ball" size=".1"/></body>
  </worldbody>
</mujoco>
"""
OPTIONS = {each.name: each for each in options_of(ViewOptions)}


def test_choices_are_those_that_are_implemented() -> None:
    assert set(VIEWS) == set(image_format.FORMATS)
    assert set(RENDERERS) == set(IMPLEMENTED_RENDERERS)
    assert set(CALIBRATION_FORMATS) == set(calibration_writer.FORMATS)
    assert set(CORNERS) == set(text.CORNERS)
    assert STYLES == ("color", "exact")
    assert ENGINES == (step_timing.C, step_timing.WARP)
    assert set(INTEGRATORS) == set(enum_members(mujoco.mjtIntegrator))
    assert sorted(SEVERITIES) == sorted(finding.SEVERITIES)
    assert sorted(REPORT_FORMATS) == sorted(report_formats.FORMATS)
    assert set(re.findall(r"\w+", BACKENDS)) - {"or"} <= {backend.AUTO, *backend.BACKENDS}


def test_the_examples_in_the_help_of_cameras_are_cameras_of_their_rigs() -> None:
    box = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body name='box'/></worldbody></mujoco>")
    for kind, example in RIG_EXAMPLES.items():
        (shot,) = parse_camera(example, box).shots
        assert shot.rig.kind == kind
        assert f" {kind}" in OPTIONS["camera"].help
        assert f" {example}" in OPTIONS["camera"].help


def test_every_quality_and_layout_can_be_drawn_and_no_other() -> None:
    assert [Visual(quality=name).quality for name in QUALITIES] == [*QUALITIES]
    with pytest.raises(UnknownNameError):
        Visual(quality="best")
    assert [columns(4, (64, 48), name) for name in LAYOUTS] == [4, 1, 2]
    with pytest.raises(UnknownNameError):
        columns(4, (64, 48), "pile")


def test_there_is_an_option_for_the_groups_of_each_kind_of_object() -> None:
    assert {name for name in OPTIONS if name.endswith("group")} == {f"{kind}group" for kind in GROUPS}


@pytest.mark.parametrize(
    ("option", "names"),
    [("show", flags), ("hide", flags), ("frame_axes", frame_axes), ("label", labels), ("seg_by", groupings)],
)
def test_names_in_help_are_those_there_are(option: str, names: Callable[[], list[str]]) -> None:
    listed = re.findall(r"[a-z][a-z-]*", OPTIONS[option].help.partition(":")[2].replace(" or ", " "))
    assert listed
    assert set(listed) <= set(names())


def test_python_may_give_one_or_several_and_a_wrong_one_is_named() -> None:
    view = ViewOptions(camera=0, view=["rgb", "depth"], show="joint,contactpoint", size=(64, 48))
    assert (view.camera, view.view, view.show) == (("0",), ("rgb", "depth"), ("joint", "contactpoint"))
    with pytest.raises(BadValueError, match=r"^view: .*deep.* is not one of rgb, depth, seg"):
        ViewOptions(view=["rgb", "deep"])
    with pytest.raises(BadValueError, match=r"^depth_range: '2, 1' is not two depths in metres, the nearer first"):
        ViewOptions(depth_range=(2, 1))


def test_rules_have_the_severities_that_can_be_asked_for() -> None:
    assert {rule.severity for rule in RULES.values()} <= set(SEVERITIES)


def test_codes_in_help_are_codes_of_rules() -> None:
    (select,) = (each for each in options_of(CheckOptions) if each.name == "select")
    codes = re.findall(r"MJ\d+", select.help)
    assert codes
    assert all(any(code.startswith(each) for code in RULES) for each in codes)


def test_every_format_of_episodes_has_its_extra_and_the_functions_of_a_format() -> None:
    for name in EPISODE_FORMATS:
        module = import_module(f"mjrun.formats.episodes.{name}")
        assert callable(module.check)
        assert callable(module.write)


def test_every_output_has_a_file_and_a_manifest() -> None:
    for cls in OUTPUTS:
        names = [each.name for each in options_of(cls)]
        assert issubclass(cls, OutputOptions)
        assert names[0] == "output"
        assert "manifest" in names


def test_every_placeholder_stands_in_a_help_text() -> None:
    texts = " ".join(each.help for cls in (*OUTPUTS, PolicyOptions) for each in options_of(cls))
    assert all(placeholder in texts for placeholder in LISTS)


def test_every_example_in_help_changes_a_model(tmp_path: Path) -> None:
    path = tmp_path / "floor.xml"
    path.write_text(MODEL)
    (declared,) = (each for each in options_of(ModelOptions) if each.name == "set")
    examples = dict(re.findall(r"([\w./:*[\]]+)=(\S+?)(?=, |; |\.(?: |$))", declared.help))
    assert len(examples) == 8
    model = parse_source(str(path), overrides_of(ModelOptions(set=examples))).load()
    assert model.opt.gravity.tolist() == [0, 0, 10]
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    assert model.geom("floor").friction.tolist() == [0.1, 0.005, 0.0001]
    assert model.vis.quality.shadowsize == 1024
    assert model.body("box").pos.tolist() == [0, 0, 0.1]
    assert model.geom("ball").size[0] == 0.025
    assert model.body("box").mass[0] == pytest.approx(1200 * 4 / 3 * math.pi * 0.025**3)


def test_exports_have_no_options_about_pixels_alone() -> None:
    names = {each.name for each in options_of(ExportOptions)}
    assert names.isdisjoint(each.name for each in options_of(ImageContentOptions))
    assert {"fps", "speed", "camera", "stage", "geoms", "show", "geomgroup", "ghost"} <= names
    assert ExportOptions(None, "a.glb").fps == 30


@pytest.mark.parametrize("name", REPORT_FORMATS)
def test_every_format_of_reports_says_what_is_broken(name: str) -> None:
    assert "broken" in report_formats.FORMATS[name]([CiVerdict("m", "error", "t", "broken")])


def test_the_default_probes_can_be_measured_in_any_model(swing: Path) -> None:
    columns = [column.name for probe in select(load(swing), PROBES) for column in probe.columns]
    assert {"qpos/hinge", "energy/total", "contact/ncon"} <= set(columns)
    assert TraceOptions(None).probe == PROBES


def test_help_lists_codecs_that_a_user_can_choose() -> None:
    (declared,) = (each for each in options_of(VideoOptions) if each.name == "codec")
    assert CODEC_LIST in declared.help
    assert {"h264", "h265", "av1", "vp9", "prores", "ffv1"} <= set(with_formats(CODEC_LIST).split(", ")) <= set(CODECS)
    assert "8" in CODECS["av1"].presets


def test_every_engine_that_needs_a_library_has_an_extra() -> None:
    assert ExecutionOptions().engine in executors.ENGINES
    assert set(EXTRAS) - {"sweep", "cloud"} <= {engine.partition(":")[0] for engine in executors.ENGINES}


@pytest.mark.parametrize("text", ["", "1", "x/4", "1/x", "0/4", "5/4", "1/4/2", "-1/4"])
def test_a_task_of_a_job_is_one_of_a_number_of_tasks(text: str) -> None:
    kind = next(each.kind for each in options_of(StudyCommandOptions) if each.attribute == "task")
    assert kind.parse("4/4") == (4, 4)
    with pytest.raises(InvalidValueError, match="one of N tasks"):
        kind.parse(text)
