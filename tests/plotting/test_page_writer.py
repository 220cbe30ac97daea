"""What a page takes from files, and that it is published whole."""

import json
from pathlib import Path

import pytest

from mjrun.errors import BadValueError, FileError
from mjrun.plotting.html_page import Page
from mjrun.plotting.page_manifest import PageManifest
from mjrun.plotting.page_writer import PageWriter, included, recorded_verdicts
from mjrun.probe.verdict import Verdict


def test_manifests_are_told_from_other_files(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text('{"mjrun": "0.1.0", "seed": 3}')
    (tmp_path / "calibration.json").write_text('{"fx": 1}')
    (tmp_path / "broken.json").write_text("{")
    paths = [str(tmp_path / name) for name in ("run.json", "calibration.json", "broken.json")]
    files, manifests = included(paths, str(tmp_path / "page.html"), 10)
    assert [file.address for file in files] == ["./calibration.json", "./broken.json"]
    assert [manifest.content for manifest in manifests] == [{"mjrun": "0.1.0", "seed": 3}]
    with pytest.raises(FileError, match=r"none\.json"):
        included([str(tmp_path / "none.json")], "page.html", 10)


@pytest.mark.parametrize("result", [None, 3, [], {}, {"assertions": 1}, {"assertions": [1, {"text": 1}, None]}])
def test_a_manifest_that_says_nothing_of_assertions_has_no_verdicts(result: object) -> None:
    assert recorded_verdicts([PageManifest("m.json", {"result": result})]) == []


def test_verdicts_are_those_of_the_run() -> None:
    entry = {"text": "a < 1", "passed": False, "message": "a < 1: it is 2"}
    content = {"result": {"path": "run.csv", "assertions": [entry]}}
    assert recorded_verdicts([PageManifest("m.json", content)]) == [("run.csv", Verdict(**entry))]


def test_a_manifest_within_a_table_is_part_of_the_one_beside_it() -> None:
    inner = json.loads('{"mjrun": "1", "model": {"path": "a"}}')
    assert PageManifest("t", inner).is_part_of(PageManifest("m", {**inner, "result": {}}))
    assert not PageManifest("t", inner).is_part_of(PageManifest("m", {**inner, "model": {"path": "b"}}))


def test_a_page_is_published_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text("old")
    with PageWriter(str(path)) as writer:
        writer.write(Page("t", "m"))
    assert path.read_text() == "old"
    with PageWriter(str(path)) as writer:
        writer.write(Page("t", "m"))
        writer.publish()
    assert path.read_text().endswith("</html>\n")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["run.parquet", "page", "page.svg"])
def test_only_a_page_is_written_over(name: str, tmp_path: Path) -> None:
    with pytest.raises(BadValueError, match=r"ends with \.html"):
        PageWriter(str(tmp_path / name))
