"""The files of a fit: the fitted model, ranges for studies, the comparison and the page, published together."""

import re
from contextlib import ExitStack
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mjrun.errors import EncoderError, FileError, UsageError
from mjrun.fitting.fit import Fit, _Run
from mjrun.fitting.free_parameter import FreeParameter
from mjrun.fitting.outputs import (
    FittedModelFile,
    FitVideo,
    comparison_rows,
    write_comparison,
    write_fit_page,
    write_ranges,
)
from mjrun.fitting.result import FitResult, FittedInertia, FittedParameter, FittedSignal, InertiaQuantity
from mjrun.formats.table_reader import read_table
from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.model.sources.file import FileSource
from mjrun.model.table_column import Column
from mjrun.physics.random_distribution import parse_distribution
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.simulation import Simulation
from tests.fitting.logs import NOISE, TRUTH, noisy, simulate, write_log, write_model
from tests.fitting.problems import THREE, segments, shooting

OVERRIDES = [Override("joint/hinge.damping", "0.04999999999999999")]


def test_the_text_keeps_its_comments_and_compiles_to_the_last_bit(tmp_path: Path) -> None:
    source = FileSource(write_model(tmp_path))
    fitted = FittedModelFile(tmp_path / "fitted.xml", source)
    fitted.check(OVERRIDES)
    with ExitStack() as stack:
        output, (made,) = fitted.write(stack, OVERRIDES)
        output.publish()
    assert made.sentence == "pendulum.xml:6: damping = 0.04999999999999999"
    text = (tmp_path / "fitted.xml").read_text()
    assert text == source.path.read_text().replace('damping="0.3"', 'damping="0.04999999999999999"')
    assert FileSource(tmp_path / "fitted.xml").load().dof_damping[0] == 0.04999999999999999
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fitted.xml", "pendulum.xml"]


@pytest.mark.parametrize(
    ("friction", "free"), [(0.1, OVERRIDES), (0.2, [Override("scale:actuator/servo.gainprm", "2")])]
)
def test_a_text_of_another_model_is_refused_before_the_fit(
    tmp_path: Path, friction: float, free: list[Override]
) -> None:
    """Another included file in the folder of the output, and a gain of a servo without its bias."""
    path = write_model(tmp_path)
    servo = '<actuator><position name="servo" joint="hinge" kp="1"/></actuator>'
    path.write_text(path.read_text().replace("<worldbody>", f'<include file="more.xml"/>{servo}<worldbody>', 1))
    more = '<mujoco><worldbody><geom name="more" size=".1" friction="{}"/></worldbody></mujoco>'
    (tmp_path / "more.xml").write_text(more.format(0.2))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "more.xml").write_text(more.format(friction))
    fitted = FittedModelFile(tmp_path / "elsewhere" / "fitted.xml", FileSource(path))
    with pytest.raises(UsageError, match="would not be the fitted model"):
        fitted.check(free)
    assert [path.name for path in (tmp_path / "elsewhere").iterdir()] == ["more.xml"]


def test_a_confined_fit_refuses_a_place_where_it_could_not_check_the_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mjrun.fitting.outputs.is_readable", lambda path: path.parent != tmp_path / "out")
    source = FileSource(write_model(tmp_path))
    FittedModelFile(tmp_path / "fitted.xml", source).check(OVERRIDES)
    with pytest.raises(UsageError, match=r"out/fitted\.xml is outside the folder .*\n.*set root"):
        FittedModelFile(tmp_path / "out" / "fitted.xml", source).check(OVERRIDES)


def test_what_stands_in_an_included_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "main.xml").write_text('<mujoco><include file="pendulum.xml"/></mujoco>')
    write_model(tmp_path)
    with pytest.raises(UsageError, match=r"set in pendulum\.xml, which .*main\.xml includes"):
        FittedModelFile(tmp_path / "fitted.xml", FileSource(tmp_path / "main.xml")).check(OVERRIDES)


def test_options_that_the_fitted_model_does_not_contain_are_named(fit: Fit, tmp_path: Path) -> None:
    output = f"{tmp_path}/fitted.xml"
    changed = replace(fit.simulation, set={"joint/hinge.stiffness": "0"}, integrator="implicitfast")
    text = f"{output} contains only the fitted values, so later commands also need integrator, set"
    assert replace(fit, simulation=changed, output=output).run().remarks == [text]
    start = replace(fit.simulation, set={"joint/hinge.damping": "0.1"})  # which the fit replaces
    assert replace(fit, simulation=start, output=output).run().remarks == []


def test_a_file_that_the_model_includes_is_not_overwritten(fit: Fit, tmp_path: Path) -> None:
    """A model that replaced it would include itself."""
    model = tmp_path / "pendulum.xml"
    model.write_text(model.read_text().replace("<worldbody>", '<include file="more.xml"/><worldbody>', 1))
    more = tmp_path / "more.xml"
    more.write_text('<mujoco><worldbody><geom size=".1"/></worldbody></mujoco>')
    with pytest.raises(UsageError, match=r"more\.xml clashes with the file of the model, which is read"):
        replace(fit, output=str(more)).run()
    replace(fit, output=str(model)).run()
    assert FileSource(model).load().ngeom == 2


def test_a_model_that_is_edited_while_it_is_fitted_is_not_overwritten(fit: Fit, tmp_path: Path) -> None:
    class Editor(PythonApiReporter):
        def progress(self, what: str, done: int, total: int) -> None:
            model.write_text(edited)

    model = tmp_path / "pendulum.xml"
    edited = model.read_text().replace("rod that hangs", "rod that swings")
    with pytest.raises(FileError, match=r"pendulum\.xml: has changed since it was read, and is left unchanged"):
        replace(fit, output=str(model)).run(Editor())
    assert model.read_text() == edited


def test_it_is_xml_of_a_model_that_has_a_file(tmp_path: Path) -> None:
    source = FileSource(write_model(tmp_path))
    with pytest.raises(UsageError, match=r"a fitted model is an \.xml file"):
        FittedModelFile(tmp_path / "fitted.mjb", source).check(OVERRIDES)
    model = parse_source(str(source.path)).load()
    from mjrun.model.sources import CompiledSource

    with pytest.raises(UsageError, match=r"has no \.xml file to change"):
        FittedModelFile(tmp_path / "fitted.xml", CompiledSource(model)).check(OVERRIDES)


FREE = [
    FreeParameter("joint/hinge.damping", 0.001, 1.0, 0.3),
    FreeParameter("delay:ctrl/motor", 0, 0.1, 0, delayed=("ctrl/motor",)),
]
FITTED = [FittedParameter(each.path, each.start, 0.05, 0.0304, 0.0696, 100.0, "") for each in FREE]


def test_the_interval_is_that_of_the_distribution(tmp_path: Path) -> None:
    with ExitStack() as stack:
        files = write_ranges(stack, str(tmp_path / "ranges.yaml"), FREE, FITTED, 0.95).publish()
    document = yaml.safe_load(Path(files[0]).read_text("utf-8"))
    assert list(document["vary"]) == ["joint/hinge.damping"]  # no study varies a delay of a signal
    mean, spread, low, high = document["vary"]["joint/hinge.damping"]["truncnormal"]
    assert (mean, low, high) == (0.05, 0.001, 1.0)
    assert spread == pytest.approx(0.01, rel=1e-3)
    assert parse_distribution(f"truncnormal({mean}, {spread}, {low}, {high})", "vary")


@pytest.fixture
def fit(tmp_path: Path) -> Fit:
    """A quick one: everything but the damping is known."""
    model = write_model(tmp_path, **{**TRUTH, "damping": 0.2})
    times, angles = simulate(0.6)
    data = write_log(tmp_path / "log.csv", {"time": times, "qpos/hinge": noisy(angles)})
    return Fit(Simulation(str(model)), data=[str(data)], free=THREE[:1], starts=1, holdout=0)


def test_two_outputs_are_not_one_file_and_no_log_is_overwritten(fit: Fit, tmp_path: Path) -> None:
    log = str(tmp_path / "log.csv")
    with pytest.raises(UsageError, match="clashes with the log, which is read"):
        replace(fit, comparison=log).run()
    with pytest.raises(UsageError, match="clashes with the ranges"):
        replace(fit, ranges=f"{tmp_path}/fit.yaml", video=f"{tmp_path}/./fit.yaml").run()
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(FileError, match="file"):
        replace(fit, html=str(tmp_path / "file" / "fit.html")).run()
    with pytest.raises(UsageError, match=r"ranges are written as \.yaml"):
        replace(fit, ranges=f"{tmp_path}/ranges.json").run()
    (tmp_path / "study.yaml").write_text("model: m.xml\nvary: {}\n")
    with pytest.raises(FileError, match=r"study\.yaml: is not ranges of an earlier fit, and is not replaced"):
        replace(fit, ranges=f"{tmp_path}/study.yaml").run()
    with pytest.raises(UsageError, match="is given twice"):
        replace(fit, data=[log, log]).run()
    assert np.loadtxt(log, delimiter=",", skiprows=1).shape == (60, 2)


@pytest.mark.gl
@pytest.mark.parametrize(
    ("options", "path"),
    [
        ({"camera": ("free", "front")}, ("camera", 1)),
        ({"size": (9, 16)}, ("size",)),
        ({"size": (64, 1_000_000)}, ("size",)),
        ({"video": "fit.txt"}, ("video",)),
    ],
)
def test_a_video_that_cannot_be_made_is_reported_at_its_option_before_the_fit(
    fit: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], path: tuple[str | int, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(_Run, "all", pytest.fail)
    with pytest.raises(UsageError) as caught:
        replace(fit, **{"video": "fit.mp4", **options}).run()
    assert caught.value.path == path


def test_if_one_cannot_be_made_none_is(fit: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise EncoderError("no")

    monkeypatch.setattr(FitVideo, "writer", fail)
    names = {"output": "fitted.xml", "comparison": "fit.csv", "ranges": "ranges.yaml", "html": "fit.html"}
    files = {key: str(tmp_path / name) for key, name in names.items()}
    before = sorted(tmp_path.iterdir())
    with pytest.raises(EncoderError):
        replace(fit, **files, video=str(tmp_path / "fit.mp4")).run()  # type: ignore[arg-type]
    assert sorted(tmp_path.iterdir()) == before


def test_each_sample_has_a_row_with_what_both_models_say(tmp_path: Path) -> None:
    shoot, _ = shooting(THREE)
    (log,) = segments()
    parts = {"fitted": log.part(slice(0, 200)), "held": log.part(slice(200, 300))}
    solutions = {}
    for part, segment in parts.items():
        chunks = shoot.cut([segment], 60)
        for which, coordinate in (("nominal", 0.9), ("fitted", 0.5)):
            states = shoot.guessed(chunks, None)
            solutions[part, which] = shoot.look(chunks, np.full(3, coordinate), states, np.array([NOISE]))
    rows = comparison_rows(solutions, ["other", "log"])
    with ExitStack() as stack:
        files = write_comparison(stack, str(tmp_path / "fit.csv"), [Column("qpos/hinge", "rad")], rows).publish()
    table = read_table(files[0]).columns
    np.testing.assert_array_equal(table["time"], log.times)
    np.testing.assert_allclose(table["qpos/hinge"], log.values[:, 0], atol=1e-12)
    assert table["holdout"].tolist() == [0] * 200 + [1] * 100
    assert set(table["log"]) == {1}
    errors = table["qpos/hinge/fitted"] - table["qpos/hinge"]
    expected = solutions["fitted", "fitted"].residuals[0][:, 0] * NOISE
    np.testing.assert_allclose(errors[: len(expected) - 1], expected[:-1], atol=1e-12)
    assert not np.allclose(table["qpos/hinge/nominal"], table["qpos/hinge/fitted"], atol=1e-3)


def test_logs_follow_each_other_although_their_times_overlap() -> None:
    shoot, _ = shooting(THREE)
    one, other = (replace(segments(seconds=1.0, seed=seed)[0], source=name) for seed, name in enumerate("ab"))
    chunks = shoot.cut([one, other], 60)
    looks = [shoot.look(chunks, np.full(3, 0.5), shoot.guessed(chunks, None), np.array([NOISE]))] * 2
    rows = comparison_rows({("fitted", "nominal"): looks[0], ("fitted", "fitted"): looks[1]}, ["a", "b"])
    np.testing.assert_array_equal(rows[:, -1], np.repeat([0, 1], 100))
    np.testing.assert_array_equal(rows[:, 0], np.tile(one.times, 2))
    np.testing.assert_allclose(rows[100:, 1], other.values[:, 0], atol=1e-12)


LOGS = ("one.csv", "<two>.csv")
RESULT = FitResult(
    parameters=[
        FittedParameter("joint/a.damping", 0.1, 0.25, 0.2, 0.3, 900.0, "", "N·m·s/rad"),
        FittedParameter("delay:ctrl/<b>", 0.0, 0.5, 0.4, 0.5, 900.0, "high", "s"),
    ],
    inertias=[FittedInertia("payload", [InertiaQuantity("mass", "kg", 0.7, 1.4, 1.39, 1.42)])],
    signals=[FittedSignal("qpos/a", "rad", 0.002, 1.25, 0.5, 0.0123, None, None)],
    reduced_chi2=1.5625,
    correlation=[[1.0, -0.97], [-0.97, 1.0]],
    confidence=0.9,
    condition=12.5,
    rows=1200,
    segments=2,
    rollouts=5000,
    changes=["a.xml:3: damping = 0.25"],
    remarks=["3 samples are missing"],
    ways=["whole segments", "stretches of 24 rows"],
    files=[],
    wall=1.5,
)


class Reader(HTMLParser):
    """Collects tags and text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def page(folder: Path) -> str:
    times = np.arange(0, 2, 0.01)
    measured = np.sin(times)
    held = (times > 1.5).astype(float)
    rows = [np.column_stack([times, measured, measured + 0.1, measured + 0.01, held, np.full(200, i)]) for i in (0, 1)]
    path = folder / "fit.html"
    with ExitStack() as stack:
        rows_of_all = np.concatenate(rows)
        write_fit_page(stack, str(path), "arm.xml", RESULT, [Column("qpos/a", "rad")], rows_of_all, LOGS).publish()
    return path.read_text("utf-8")


def test_all_that_was_found_is_on_a_page_that_is_complete_in_itself_and_the_same_every_time(tmp_path: Path) -> None:
    text = page(tmp_path)
    read = Reader(text)
    for part in (
        "Fit of arm.xml",
        "0.2 … 0.3",
        "90 % interval",
        "at its high bound",
        "delay:ctrl/<b> [s]",
        "1.39 … 1.42",
    ):
        assert part in read.texts
    for part in ("1.23 %", "−0.97", "a.xml:3: damping = 0.25", "3 samples are missing", "1.562"):
        assert part in read.texts
    assert "1,200 rows in 2 segments" in read.texts
    assert "joint/a.damping [N·m·s/rad]" in read.texts

    assert read.tags.count("svg") == 2  # for each log, with its signals
    assert "<two>.csv: measured, predicted by the original model, and predicted by the fitted model" in read.texts
    for legend in ("measured", "before", "fitted", "held out"):
        assert read.texts.count(legend) >= 2
    assert "comparison.npz" not in text

    assert "script" not in read.tags
    assert not re.findall(r'(?:src|href)="(?!#|data:)', text)
    assert page(tmp_path) == text
