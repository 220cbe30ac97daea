"""A fit document is the fit that it says, or a list of what is wrong with it, line by line."""

from pathlib import Path

import numpy as np
import pytest

from mjrun.document.fit import read_fit
from mjrun.errors import DocumentError, UsageError
from mjrun.fitting.fit import Fit
from mjrun.simulation.simulation import Simulation
from tests.fitting.logs import write_log, write_model

HEAD = "model: pendulum.xml\ndata: [log.csv]\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_model(tmp_path)
    times = np.arange(100) * 0.01
    write_log(tmp_path / "log.csv", {"time": times, "qpos/hinge": np.sin(times)})
    return tmp_path


def read(text: str, *assignments: str) -> Fit:
    Path("d.yaml").write_text(HEAD + text)
    return read_fit("d.yaml", assignments).made


def test_it_says_what_the_command_line_says() -> None:
    free = (("joint/hinge.damping", "log:1e-3..1"), ("delay:ctrl/motor", "0..0.1"))
    expected = Fit(
        Simulation("pendulum.xml", key=None, seed=4, map=("qpos/hinge=angle",)),
        data=("log.csv",),
        free=free,
        holdout=0.1,
        loss="huber",
        output="fitted.xml",
    )
    text = (
        "free: {joint/hinge.damping: 'log:1e-3..1', 'delay:ctrl/motor': 0..0.1}\nholdout: 0.1\nloss: huber\nseed: 4\n"
    )
    assert read(f"{text}map: [qpos/hinge=angle]\noutput: fitted.xml") == expected


def test_files_that_are_read_are_relative_to_the_document(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("d.yaml").write_text(f"{HEAD}free: {{joint/hinge.damping: 0..1}}\noutput: fitted.xml")
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    fit = read_fit("../d.yaml").made
    assert Path(fit.data[0]).resolve() == folder / "log.csv"
    assert fit.simulation.load().nq == 1
    assert fit.output == "fitted.xml"


def test_values_of_the_command_line_count_instead() -> None:
    fit = read("free: {joint/hinge.damping: 0..1}", "free.joint/hinge.damping=0..2", "starts=5")
    assert (fit.free, fit.starts) == ((("joint/hinge.damping", "0..2"),), 5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("holdout: 2", "d.yaml:3:10: holdout: expected a number of at most 0.9"),
        ("fre: {}", "d.yaml:3:1: .*did you mean 'free'"),
        ("loss: l2", "d.yaml:3:7: loss: expected 'linear', 'soft_l1', 'huber' or 'cauchy'"),
        ("controller: a.py:act", "d.yaml:3:1: "),
    ],
)
def test_mistakes_are_reported_at_their_lines(text: str, message: str) -> None:
    with pytest.raises(DocumentError, match=message):
        read(text)


def test_what_is_wrong_with_the_fit_is_reported_at_its_line() -> None:
    Path("d.yaml").write_text(f"{HEAD}free:\n  joint/hinge.dampin: 0..1")
    request = read_fit("d.yaml")
    with pytest.raises(UsageError, match=r"d\.yaml:4:3: free\.joint/hinge\.dampin: no setting"), request.located():
        request.made.run()
