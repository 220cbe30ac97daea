"""Files that the table of a study does not use are removed, and no others."""

import json
import os
import shutil
from pathlib import Path

import pytest

from mjrun.errors import FileError
from mjrun.formats.temporary_output import TemporaryOutput
from mjrun.study.leases import EXPIRY, Leases
from mjrun.study.part_files import PartFiles
from mjrun.study.results import ResultRows
from mjrun.study.spec import PointResult
from mjrun.study.status import remove_unused

STUDY, OTHER = "ab" * 32, "cd" * 32


def write(folder: Path, study: str, points: range, metric: str = "m") -> Path:
    """Writes a part of a study."""
    files = PartFiles(folder, [metric], study)
    results = ResultRows.of([PointResult(point, "ok", (1.0,), 1) for point in points], 1)
    return folder / "parts" / files.write(points, [f"{point:032x}" for point in points], results)


@pytest.fixture
def used(tmp_path: Path) -> set[Path]:
    """A finished study of three points, with a file of the user whose columns are others."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "study.json").write_text(json.dumps({"points": 3, "metrics": {"m": "1"}, "digest": STUDY}))
    foreign = write(tmp_path, OTHER, range(2)).rename(tmp_path / "parts" / "mine.parquet.backup")
    (tmp_path / "parts" / "mine.parquet").write_text("no table")
    (tmp_path / "parts" / ".hidden").touch()
    return {write(tmp_path, STUDY, range(3)), foreign, tmp_path / "study.json", tmp_path / "parts" / "mine.parquet",
            tmp_path / "parts" / ".hidden"}  # fmt: skip


def everything(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if path.is_file()}


def test_only_what_the_table_does_not_use_is_removed(tmp_path: Path, used: set[Path]) -> None:
    write(tmp_path, OTHER, range(2))
    write(tmp_path, OTHER, range(9), metric="other")
    damaged = shutil.copy(write(tmp_path, STUDY, range(3)), tmp_path / "parts" / f"{STUDY[:16]}-0-9-{'0' * 16}.parquet")
    os.truncate(damaged, 100)
    (tmp_path / "parts" / f"{OTHER[:16]}-0-1-01234567.lease").write_text("of a machine that has failed")
    os.utime(tmp_path / "parts" / f"{OTHER[:16]}-0-1-01234567.lease", (0, 0))
    TemporaryOutput(tmp_path / "results.parquet").release()
    (tmp_path / "slurm" / "01234567").mkdir(parents=True)
    (tmp_path / "slurm" / "01234567" / "1_0_log.err").write_text("error")

    before = everything(tmp_path)
    shown = remove_unused(tmp_path, dry_run=True)
    assert everything(tmp_path) == before
    removed = remove_unused(tmp_path)
    assert everything(tmp_path) == used
    assert removed.kinds == shown.kinds
    assert {each.noun: each.files for each in removed.kinds} == {
        "outdated part": 2, "damaged part": 1, "abandoned lease": 1, "temporary file": 1, "log folder": 1
    }  # fmt: skip
    sizes = {each.noun: each.size for each in removed.kinds}
    assert (sizes["damaged part"], sizes["abandoned lease"], sizes["log folder"]) == (100, 28, 5)
    assert remove_unused(tmp_path).kinds == []


def test_nothing_is_removed_while_a_process_works_on_the_study(tmp_path: Path, used: set[Path]) -> None:
    other = write(tmp_path, OTHER, range(2))
    with Leases(PartFiles(tmp_path, [], OTHER).ranges) as leases:
        assert leases.claim(0, 1, 2)
        (lease,) = tmp_path.rglob("*.lease")
        elsewhere = json.loads(lease.read_text()) | {"host": "node", "process": ""}
        lease.write_text(json.dumps(elsewhere))
        with pytest.raises(FileError, match="belongs to a process on node that works on the study"):
            remove_unused(tmp_path)
        assert other.exists()
        past = lease.stat().st_mtime - 2 * EXPIRY
        os.utime(lease, (past, past))
        remove_unused(tmp_path)
    assert everything(tmp_path) == used


def test_parts_of_other_versions_stay_as_long_as_points_are_missing(tmp_path: Path, used: set[Path]) -> None:
    other = write(tmp_path, OTHER, range(2))
    facts = json.loads((tmp_path / "study.json").read_text())
    (tmp_path / "study.json").write_text(json.dumps(facts | {"points": 5}))
    assert remove_unused(tmp_path).missing == 2
    assert everything(tmp_path) == {*used, other}
