"""Plots of a real study."""

from pathlib import Path

import pytest
from PIL import Image

from mjrun.errors import UsageError
from mjrun.plotting.study_plot import StudyPlot
from mjrun.simulation.simulation import Simulation
from mjrun.study.study import Study


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = str(tmp_path_factory.mktemp("study"))
    simulation = Simulation("scene:pendulum", duration="0.2", qvel={"hinge": 1.0})
    drift = ("drift", "max(abs(energy/drift))")
    Study(simulation, folder, vary=(("opt.timestep", "log:1e-3..1e-2:3"),), metric=(drift,), jobs=1).run()
    return folder


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_a_study_is_a_picture_and_the_same_bytes_again(study: str, suffix: str, tmp_path: Path) -> None:
    results = [StudyPlot(study, str(tmp_path / f"{i}.{suffix}"), size=(640, 480)).run() for i in range(2)]
    assert (tmp_path / f"0.{suffix}").read_bytes() == (tmp_path / f"1.{suffix}").read_bytes()
    assert (results[0].panels, results[0].rows, results[0].curves) == (["drift"], [3], 1)
    if suffix == "png":
        with Image.open(tmp_path / "0.png") as image:
            assert image.size == (640, 480)


def test_a_study_has_a_page(study: str, tmp_path: Path) -> None:
    result = StudyPlot(study, html=str(tmp_path / "page.html")).run()
    assert (result.path, result.format) == (str(tmp_path / "page.html"), "html")
    assert "drift" in (tmp_path / "page.html").read_text("utf-8")


def test_what_a_study_cannot_have_is_told(study: str) -> None:
    with pytest.raises(UsageError, match="is for tables"):
        StudyPlot(study, "a.png", mark=("a=1",)).run()
    with pytest.raises(UsageError, match="one study"):
        StudyPlot([study, "b.csv"], "a.png").run()
    with pytest.raises(UsageError, match="nothing to make"):
        StudyPlot(study).run()
