"""The page about a fit, read as a browser reads it."""

import re
from contextlib import ExitStack
from html.parser import HTMLParser
from pathlib import Path

import numpy as np

from mjrun.fitting.outputs import write_fit_page
from mjrun.fitting.result import FitResult, FittedInertia, FittedParameter, FittedSignal, InertiaQuantity
from mjrun.model.table_column import Column

LOGS = ("one.csv", "<two>.csv")
RESULT = FitResult(
    parameters=[
        FittedParameter("joint/a.damping", 0.1, 0.25, 0.2, 0.3, 900.0, ""),
        FittedParameter("delay:ctrl/<b>", 0.0, 0.5, 0.4, 0.5, 900.0, "high"),
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
    for part in ("Fit of arm.xml", "0.2 … 0.3", "90 % interval", "at its high bound", "delay:ctrl/<b>", "1.39 … 1.42"):
        assert part in read.texts
    for part in ("1.23 %", "−0.97", "a.xml:3: damping = 0.25", "3 samples are missing", "1.562"):
        assert part in read.texts
    assert "1,200 rows in 2 segments" in read.texts

    assert read.tags.count("svg") == 2  # for each log, with its signals
    assert "<two>.csv: measured, predicted by the original model, and predicted by the fitted model" in read.texts
    for legend in ("measured", "before", "fitted", "held out"):
        assert read.texts.count(legend) >= 2
    assert "comparison.npz" not in text

    assert "script" not in read.tags
    assert not re.findall(r'(?:src|href)="(?!#|data:)', text)
    assert page(tmp_path) == text
