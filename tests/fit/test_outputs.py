"""The files of a fit appear together or not at all."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import EncoderError, FileError, UsageError
from mjrun.fit.film import FitFilm
from mjrun.fit.fit import Fit
from mjrun.simulation.simulation import Simulation
from tests.fit.logs import TRUTH, noisy, simulate, write_log, write_model
from tests.fit.problems import THREE


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
    with pytest.raises(UsageError, match="is given twice"):
        replace(fit, data=[log, log]).run()
    assert np.loadtxt(log, delimiter=",", skiprows=1).shape == (60, 2)


def test_if_one_cannot_be_made_none_is(fit: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise EncoderError("no")

    monkeypatch.setattr(FitFilm, "writer", fail)
    names = {"output": "fitted.xml", "comparison": "fit.csv", "ranges": "ranges.yaml", "html": "fit.html"}
    files = {key: str(tmp_path / name) for key, name in names.items()}
    before = sorted(tmp_path.iterdir())
    with pytest.raises(EncoderError):
        replace(fit, **files, video=str(tmp_path / "fit.mp4")).run()  # type: ignore[arg-type]
    assert sorted(tmp_path.iterdir()) == before
