"""The page of a run shows everything that was made, whatever failed."""

from dataclasses import asdict
from pathlib import Path

import pytest

from mjrun.errors import BadValueError, FailedAssertionError, FileError, PartlyDoneError
from mjrun.options.report import PageOptions
from mjrun.outputs.keyframe import KeyframeResult
from mjrun.outputs.output import OutputRequest, OutputResult
from mjrun.outputs.perform import perform
from mjrun.outputs.plot import Plot
from mjrun.outputs.recording import RecordingResult
from mjrun.outputs.run_report import RESULTS, RunResult, run_page
from mjrun.outputs.trace import Trace
from mjrun.plotting.html_page import PageWriter
from mjrun.simulation.simulation import Simulation
from tests.plotting.test_html_page import external_references, read


@pytest.fixture
def jobs(swing: Path, tmp_path: Path) -> list[OutputRequest[OutputResult]]:
    simulation = Simulation(str(swing), duration=0.1, qvel={"hinge": 3.0})
    return [
        Trace(simulation, str(tmp_path / "run.csv"), probe=["qpos"], assert_=["max(time) < 1"]),
        Plot(simulation, str(tmp_path / "p.png"), probe=["qpos"], size=(320, 240)),
    ]


def test_it_holds_tables_images_verdicts_and_what_made_them(
    jobs: list[OutputRequest[OutputResult]], tmp_path: Path
) -> None:
    page = tmp_path / "page.html"
    with run_page(PageOptions(html=str(page)), "study.yaml", jobs) as published:
        perform(jobs, published=published)
        assert not page.exists()
    html = page.read_text()
    text = read(html).text
    assert external_references(html) == []
    for part in (
        "study.yaml",
        "1 assertion passed",
        "run.csv: qpos/hinge [rad]",
        "51 rows",
        "p.png",
        "Files that were made (1)",
    ):
        assert part in text
    assert html.count("<svg") == 1
    assert "data:image/png;base64," in html


def test_it_is_made_when_an_assertion_fails_too(
    jobs: list[OutputRequest[OutputResult]], swing: Path, tmp_path: Path
) -> None:
    trace = Trace(Simulation(str(swing), steps=3), str(tmp_path / "run.csv"), assert_=["max(time) < 0"])
    with (
        pytest.raises(FailedAssertionError),
        run_page(PageOptions(html=str(tmp_path / "page.html")), "t", [trace]) as published,
    ):
        perform([trace], published=published)
    assert "1 of 1 assertions failed" in (tmp_path / "page.html").read_text()


def test_a_page_that_fails_at_the_end_says_what_was_made(
    swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(writer: PageWriter, page: object) -> None:
        raise FileError(writer.destination.shown, "cannot be written: the disk is full")

    monkeypatch.setattr(PageWriter, "write", failing)
    table, contacts, page = (str(tmp_path / name) for name in ("run.csv", "contacts.csv", "page.html"))
    trace = Trace(Simulation(str(swing), steps=3), table, contacts=contacts)
    with pytest.raises(PartlyDoneError) as caught, run_page(PageOptions(html=page), "t", [trace]) as published:
        perform([trace], published=published)
    assert caught.value.made == [table, contacts]
    assert [failure["output"] for failure in caught.value.failures] == [page]
    assert [result.path for result in caught.value.results] == [table]


def test_nothing_is_published_if_nothing_was_made(jobs: list[OutputRequest[OutputResult]], tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), run_page(PageOptions(html=str(tmp_path / "page.html")), "t", jobs):
        raise ZeroDivisionError
    assert not list(tmp_path.glob("*.html"))


def test_a_page_that_cannot_be_written_is_reported_before_the_run(
    jobs: list[OutputRequest[OutputResult]], tmp_path: Path
) -> None:
    for name, error in (("page.txt", BadValueError), ("/dev/null/page.html", FileError)):
        with pytest.raises(error), run_page(PageOptions(html=str(tmp_path / name)), "t", jobs):
            raise AssertionError


def test_every_kind_of_output_is_known_by_its_name() -> None:
    assert {f"{kind}Result": result for kind, result in RESULTS.items()} == {
        result.__name__: result for result in OutputResult.__subclasses__()
    }


def test_a_document_has_the_results_in_their_order() -> None:
    key = KeyframeResult("k.xml", "end", 0.03, 3, wall=0.1)
    recording = RecordingResult("r.npz", 4, 9, 0.03, wall=0.1)
    first, second = RunResult([recording, key]).document()["results"]  # type: ignore[misc]
    assert first == {"kind": "Recording", **asdict(recording)}
    assert second == {"kind": "Keyframe", **asdict(key)}
