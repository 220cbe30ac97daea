"""The files of a fit: the fitted model, ranges for studies, and their publication together."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from mjrun.errors import EncoderError, FileError, UsageError
from mjrun.fitting.fit import Fit
from mjrun.fitting.free_parameter import FreeParameter
from mjrun.fitting.outputs import FittedModelFile, FitVideo, write_ranges
from mjrun.fitting.result import FittedParameter
from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.model.sources.file import FileSource
from mjrun.physics.random_distribution import parse_distribution
from mjrun.simulation.simulation import Simulation
from tests.fitting.logs import TRUTH, noisy, simulate, write_log, write_model
from tests.fitting.problems import THREE

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


def test_a_place_where_it_would_be_another_model_is_refused(tmp_path: Path) -> None:
    write_model(tmp_path)
    (tmp_path / "pendulum.xml").write_text(
        (tmp_path / "pendulum.xml").read_text().replace("<worldbody>", '<include file="more.xml"/><worldbody>', 1)
    )
    more = '<mujoco><worldbody><geom name="more" size="{}"/></worldbody></mujoco>'
    (tmp_path / "more.xml").write_text(more.format(0.1))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "more.xml").write_text(more.format(0.2))
    fitted = FittedModelFile(tmp_path / "elsewhere" / "fitted.xml", FileSource(tmp_path / "pendulum.xml"))
    with ExitStack() as stack, pytest.raises(FileError, match="would not be the fitted model"):
        fitted.write(stack, OVERRIDES)
    assert [path.name for path in (tmp_path / "elsewhere").iterdir()] == ["more.xml"]


def test_what_stands_in_an_included_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "main.xml").write_text('<mujoco><include file="pendulum.xml"/></mujoco>')
    write_model(tmp_path)
    with pytest.raises(UsageError, match=r"set in pendulum\.xml, which .*main\.xml includes"):
        FittedModelFile(tmp_path / "fitted.xml", FileSource(tmp_path / "main.xml")).check(OVERRIDES)


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
    with pytest.raises(UsageError, match="is given twice"):
        replace(fit, data=[log, log]).run()
    assert np.loadtxt(log, delimiter=",", skiprows=1).shape == (60, 2)


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
