"""The status of a study is what its folder shows: parts, and the leases of the processes that work on it."""

import json
import os
import time
from pathlib import Path

import pytest

from mjrun.errors import FailedPointsError, FileError
from mjrun.formats.local_and_remote_folders import LocalFolder
from mjrun.simulation.simulation import Simulation
from mjrun.study.leases import Leases
from mjrun.study.part_files import PartFiles
from mjrun.study.status import REFRESH, age, span_of_time, study_status, write_status_page
from mjrun.study.study import Study


@pytest.fixture
def folder(ball: Simulation, tmp_path: Path) -> Path:
    """A study of six points, of which two are unstable; its model is gone."""
    vary = {"qpos/ball/z": "0.2,0.6,1", "qvel/ball/vz": "0,-1e9"}
    with pytest.raises(FailedPointsError):
        Study(ball, str(tmp_path / "study"), vary=vary, metric={"low": "min(qpos/ball/z)"}, jobs=1).run()
    Path(str(ball.model)).unlink()
    return tmp_path / "study"


def test_a_study_without_a_process_is_finished_or_not(folder: Path) -> None:
    status = study_status(folder)
    assert status.is_finished
    assert (status.points, status.done, status.failed, status.running) == (6, 6, 3, [])
    assert status.statuses == {"ok": 3, "unstable": 3}
    assert status.text == f"{folder}: 6 of 6 points (3 ok, 3 unstable), finished"
    for part in (folder / "parts").iterdir():
        part.unlink()
    status = study_status(folder)
    assert (status.done, status.failed, status.is_finished, status.rate, status.remaining) == (0, 0, False, None, None)
    assert status.text.endswith("0 of 6 points, no process works on it")


def test_running_ranges_have_a_machine_a_rate_and_a_time_that_remains(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    digest = json.loads((folder / "study.json").read_text())["digest"]
    for part in (folder / "parts").iterdir():
        part.unlink()
    with Leases(PartFiles(folder, [], digest).ranges) as one, Leases(PartFiles(folder, [], digest).ranges) as other:
        assert one.claim(0, 1, 2)
        assert other.claim(4, 5, 2)
        content, lease = {"process": ""}, folder
        for number, lease in enumerate(sorted((folder / "parts").iterdir())):
            content = json.loads(lease.read_text())
            lease.write_text(
                json.dumps({**content, "host": "node", "points": 10 * number, "seconds": 4.0, "losses": number})
            )
        status = study_status(folder)
        assert [(each.first, each.last, each.left, each.host) for each in status.running] == [
            (0, 1, 2, "node"),
            (4, 5, 2, "node"),
        ]
        assert len({each.owner for each in status.running}) == 2
        assert (status.rate, status.remaining) == (2.5, 6 / 2.5)
        counts = "0 of 6 points, 2.5 points/s, about 2.4 s left, 1 Slurm job lost and submitted again"
        assert (status.text.endswith(counts), status.lost) == (True, 1)
        with monkeypatch.context() as patch:
            now = time.time
            patch.setattr(time, "time", lambda: now() + 7200)  # the clock of this machine is two hours ahead
            patch.delattr(LocalFolder, "create_file")  # a status writes no file with a name
            assert [age(each) for each in study_status(folder).running] == ["", ""]
            os.utime(lease, (now() - 9000, now() - 9000))
            assert [age(each) for each in study_status(folder).running] == ["", "not renewed for 2.5 h"]
        lease.write_text(json.dumps({**content, "process": content["process"].replace(" ", " 9", 1)}))
        assert len(study_status(folder).running) == (1 if content["process"] else 2)  # the other has ended


def test_a_page_loads_itself_again_while_the_study_runs(folder: Path, tmp_path: Path) -> None:
    digest, page = json.loads((folder / "study.json").read_text())["digest"], tmp_path / "page.html"
    (folder / "parts" / "other.lease").write_text("{}")
    with Leases(PartFiles(folder, [], digest).ranges) as leases:
        assert leases.claim(0, 5, 6)
        write_status_page(str(page), study_status(folder))
        assert "refresh" not in page.read_text()  # all points are known
        for part in (folder / "parts").glob("*.parquet"):
            part.unlink()
        status = study_status(folder)
        write_status_page(str(page), status)
        assert f'<meta http-equiv="refresh" content="{REFRESH}">' in page.read_text()
        assert "0 … 5" in page.read_text()


def test_a_folder_that_shows_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"has no study\.json"):
        study_status(tmp_path)
    unlikely = [f'{{"points": {count}, "metrics": {{}}, "digest": "ab"}}' for count in (0, 10**12, 10**30)]
    for text in ("x", "[]", '{"points": 5}', *unlikely):
        (tmp_path / "study.json").write_text(text)
        with pytest.raises(FileError):
            study_status(tmp_path)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (42, "42 s"),
        (99.6, "100 s"),
        (480, "8 min"),
        (5980, "100 min"),
        (12000, "3.3 h"),
        (0.012, "12 ms"),
        (0.0996, "100 ms"),
        (0.00015, "150 us"),
    ],
)
def test_a_time_has_a_suitable_unit(seconds: float, text: str) -> None:
    assert span_of_time(seconds) == text
