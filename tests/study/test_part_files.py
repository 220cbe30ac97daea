"""Parts on disk read back unchanged; keys change with everything that determines a result, and with nothing else."""

import math
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from shutil import copy

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from mjrun.document.task import read_task
from mjrun.errors import FileError
from mjrun.simulation.simulation import Simulation
from mjrun.study.leases import Leases
from mjrun.study.part_files import PartFiles, PartWriter, point_keys, study_identity
from mjrun.study.results import ResultRows
from mjrun.study.spec import PointResult, StudySpec
from tests.packages import planted
from tests.study.models import BALL

SCENES = Path(__file__).parents[2] / "scenes"
RESULTS = [
    PointResult(0, "ok", (1.5, math.inf), 9, wall=0.1),
    PointResult(1, "crashed", (math.nan,) * 2, 0, 139, "ü\n", 1.0),
]


KEYS = [f"{index:032x}" for index in range(1, 9)]
STUDY = "ab" * 32


def files_in(folder: Path, study: str = STUDY, metrics: Sequence[str] = ("a", "b")) -> PartFiles:
    files = PartFiles(folder, metrics, study)
    files.create()
    return files


def keys_of(points: np.ndarray) -> list[str]:
    return [KEYS[point] for point in points]


def write(files: PartFiles, points: Sequence[int], results: Sequence[PointResult]) -> Path:
    name = files.write(points, keys_of(np.array(points)), ResultRows.of(results, files.width, "host"))
    return Path(files.folder.path(name))


def read(files: PartFiles, points: range = range(len(KEYS))) -> dict[int, str]:
    """Returns the status of each known point."""
    known = files.read(points, keys_of)
    return {result.index: result.status for result in known if result.status != "missing"}


def broken_keys(points: np.ndarray) -> list[str]:
    raise AssertionError("keys are compared")


@pytest.mark.parametrize("name", ["study", os.fsdecode(b"caf\xe9")], ids=["plain", "not UTF-8"])
def test_results_read_back(tmp_path: Path, name: str) -> None:
    write(files_in(tmp_path / name), [0, 1], RESULTS)
    known = files_in(tmp_path / name).read(range(2), broken_keys)
    assert [*map(str, known)] == [*map(str, RESULTS)]
    assert read(files_in(tmp_path / name, metrics=["a"])) == {}  # of a study with other metrics


@pytest.fixture
def files(tmp_path: Path) -> PartFiles:
    return files_in(tmp_path)


def test_a_good_result_wins_over_a_failed_one(files: PartFiles) -> None:
    for order in ([0, 1], [1, 0]):
        for each in order:
            write(files, [each, 2 + each, 4], [RESULTS[each]] * 3)
    assert read(files) == {0: "ok", 1: "crashed", 2: "ok", 3: "crashed", 4: "ok"}


def test_a_damaged_part_is_named_and_other_files_are_passed_over(files: PartFiles, tmp_path: Path) -> None:
    pyarrow.parquet.write_table(pyarrow.table({"x": [1]}), tmp_path / "parts" / "mine.parquet")
    assert read(files) == {}
    part = write(files, [0], RESULTS[:1])
    (tmp_path / "parts" / "broken.parquet").write_text("x")
    cut = write(files, [1], RESULTS[:1])
    cut.write_bytes(cut.read_bytes()[:-9])
    assert part != cut
    assert read(files) == {0: "ok"}
    assert {*files.damaged} == {"broken.parquet", cut.name}


def test_a_part_with_any_wrong_byte_in_its_pages_is_damaged(files: PartFiles, tmp_path: Path) -> None:
    part = write(files, [0, 1], RESULTS)
    content = part.read_bytes()
    footer = len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    for place in range(4, footer):
        part.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        fresh = files_in(tmp_path)
        known = fresh.read(range(2), keys_of)
        assert fresh.damaged == [part.name] or [*map(str, known)] == [*map(str, RESULTS)]


def test_a_part_with_a_wrong_bit_in_its_metadata_has_its_results_or_none(files: PartFiles, tmp_path: Path) -> None:
    part = write(files, [0, 1], RESULTS)
    content = part.read_bytes()
    footer = len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    for place in range(footer, footer + 200):
        bit = 1 << place % 8
        part.write_bytes(content[:place] + bytes([content[place] ^ bit]) + content[place + 1 :])
        known = files_in(tmp_path).read(range(2), keys_of)
        assert all(each.status == "missing" or str(each) == str(RESULTS[each.index]) for each in known)


def test_a_part_is_opened_only_for_its_points(files: PartFiles) -> None:
    parts = [write(files, [point, point + 1], [RESULTS[0]] * 2) for point in (0, 2, 4, 6)]
    for part in (parts[0], parts[3]):
        part.write_text("damaged")
    assert read(files, range(3, 6)) == {3: "ok", 4: "ok", 5: "ok"}
    assert files.damaged == []


def test_parts_of_another_design_are_read_by_keys_and_those_of_another_study_are_not(tmp_path: Path) -> None:
    before = files_in(tmp_path, "cd" * 32)
    write(before, [5, 6], [RESULTS[0]] * 2)  # whose numbers have changed since

    def moved(points: np.ndarray) -> list[str]:
        return [KEYS[(point + 3) % len(KEYS)] for point in points]

    files = files_in(tmp_path)
    known = files.read(range(len(KEYS)), moved)
    assert np.flatnonzero(~known.is_missing).tolist() == [2, 3] == files.adopted.tolist()
    files.write(files.adopted, moved(files.adopted), known.rows(files.adopted))
    again = files.read(range(2, 4), broken_keys)
    assert [str(replace(result, index=0)) for result in again] == [str(RESULTS[0])] * 2
    assert files.adopted.tolist() == []


def test_points_with_one_key_have_one_result(tmp_path: Path) -> None:
    write(files_in(tmp_path, "cd" * 32), [5], RESULTS[:1])
    known = files_in(tmp_path).read(range(3), lambda points: [KEYS[5]] * len(points))
    assert known.counts == {"ok": 3}


def test_merged_parts_have_the_same_results(files: PartFiles, tmp_path: Path) -> None:
    parts = [write(files, [point, 7], [RESULTS[point % 2], RESULTS[0]]) for point in range(6)]
    other = write(files_in(tmp_path, "cd" * 32), [0], RESULTS[:1])
    before = read(files)
    assert files.merge([*(part.name for part in parts[:2]), "gone.parquet"]) is None
    files.merge_all()
    merged = [path for path in (tmp_path / "parts").iterdir() if path != other]
    assert len(merged) == 1
    assert read(files) == before == {0: "ok", 1: "crashed", 2: "ok", 3: "crashed", 4: "ok", 5: "crashed", 7: "ok"}


def test_parts_of_a_large_study_are_read_from_folders_and_beside_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mjrun.study.range_folders.SIZES", (4, 2))
    files = PartFiles(tmp_path, ["a", "b"], STUDY, len(KEYS))
    files.create()
    parts = [write(files, points, [RESULTS[0]] * len(points)) for points in ([0, 1], [2], [3, 4], [5, 6])]
    assert [len(part.relative_to(tmp_path).parts) for part in parts] == [4, 4, 2, 3]
    moved = tmp_path / "parts" / write(files, [7], RESULTS[1:]).name
    next(tmp_path.rglob(moved.name)).rename(moved)
    parts[1].write_text("damaged")
    known = {0: "ok", 1: "ok", 3: "ok", 4: "ok", 5: "ok", 6: "ok", 7: "crashed"}
    assert read(files) == known
    assert files.damaged == [str(parts[1].relative_to(tmp_path / "parts"))]
    parts[1].unlink()
    assert read(PartFiles(tmp_path, ["a", "b"], STUDY)) == known
    other = PartFiles(tmp_path, ["a", "b"], "cd" * 32)
    assert len([*filter(None, other.read(range(8), keys_of).wall.tolist())]) == 7  # by keys
    files.merge_all()
    assert len([*(tmp_path / "parts").iterdir()]) == 1
    assert read(files) == known


def test_parts_and_leases_of_a_hundred_million_points_are_in_three_levels_of_folders(tmp_path: Path) -> None:
    points = [2, 2**16, 2**24 - 1, 2**24, 3 * 2**24 + 5, 10**8 - 1]
    files, other = (PartFiles(tmp_path, ["a", "b"], STUDY, 10**8) for _ in range(2))
    files.create()
    for some in [*([point] for point in points), [2**24 - 1, 2**24]]:
        results = ResultRows.of([RESULTS[0]] * len(some), 2, "host")
        name = files.write(some, [f"{point:032x}" for point in some], results)
        assert name.count("/") == (3 if len(some) == 1 else 0)
    assert not other.read(points, broken_keys).is_missing.any()
    last = other.read(points[-1:], broken_keys)
    assert [result.index for result in last if result.status == "ok"] == points[-1:]
    with Leases(files.ranges) as own, Leases(other.ranges) as others:
        assert own.claim(2**24 - 1, 2**24, 2)
        assert not others.claim(2**24, 2**24 + 7, 8)
        assert others.claim(2**24 + 1, 2**24 + 7, 7)
    files.merge_all()
    assert [path.suffix for path in (tmp_path / "parts").iterdir()] == [".parquet"]
    assert not files.read(points, broken_keys).is_missing.any()


def test_the_number_of_parts_grows_with_the_logarithm_of_their_points(files: PartFiles, tmp_path: Path) -> None:
    with PartWriter(files, 0) as parts:
        for point in range(100):
            parts.add([point], [f"{point:032x}"], RESULTS[:1], "host")
            parts.write_if_due()
            assert len([*(tmp_path / "parts").iterdir()]) <= 7 * 3
    tables = [pyarrow.parquet.read_table(path) for path in (tmp_path / "parts").iterdir()]
    assert sorted(point for table in tables for point in table["point"].to_pylist()) == [*range(100)]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("status", ["\x1b[2J"]),
        ("status", [7]),
        ("point", [1.5]),
        ("point", [99]),
        ("steps", ["many"]),
        ("steps", pyarrow.array([None], pyarrow.int64())),
        ("message", [1.5]),
        ("metric:a", ["much"]),
        ("metric:a", pyarrow.array([None], pyarrow.float64())),
        ("wall", ["long"]),
    ],
)
def test_rows_that_mjrun_never_writes_are_passed_over(files: PartFiles, name: str, values: object) -> None:
    path = write(files, [0], RESULTS[:1])
    table = pyarrow.parquet.ParquetFile(path).read()
    table = table.set_column(table.column_names.index(name), name, pyarrow.array(values))
    pyarrow.parquet.write_table(table, path)
    assert read(files) == {}


def test_files_that_are_only_called_like_parts_are_not_merged(files: PartFiles, tmp_path: Path) -> None:
    odd = write(files, [0], RESULTS[:1])
    table = pyarrow.parquet.ParquetFile(odd).read()
    changed = table.set_column(table.column_names.index("metric:a"), "metric:a", pyarrow.array(["much"]))
    pyarrow.parquet.write_table(changed, odd)
    other = write(files_in(tmp_path, "cd" * 32), [3], RESULTS[:1])
    other = other.rename(odd.with_name(odd.name.replace("-0-0-", "-3-3-")))
    for point in (1, 2):
        write(files, [point], RESULTS[:1])

    assert read(files, range(3)) == {1: "ok", 2: "ok"}
    assert files.damaged == [odd.name]
    assert files.unused() == ([other.name], [odd.name])
    files.merge_small([part.name for part in (tmp_path / "parts").iterdir() if part not in (odd, other)])
    (merged,) = {*(tmp_path / "parts").iterdir()} - {odd, other}
    for each in (odd, other):
        assert files.merge([each.name, merged.name]) is None
    files.merge_all()
    assert {*(tmp_path / "parts").iterdir()} == {odd, other, merged}
    assert read(files, range(3)) == {1: "ok", 2: "ok"}


def keys(spec: StudySpec, names: tuple[str, ...], points: Sequence[tuple[str, ...]]) -> list[str]:
    spec = replace(spec, names=names, base=spec.base.with_snapshot())
    return point_keys(study_identity(spec, spec.base.load()), spec, points)


def test_the_key_of_a_point_changes_with_all_that_decides_its_result(tmp_path: Path) -> None:
    path = tmp_path / "ball.xml"
    path.write_text(BALL)
    spec = StudySpec(Simulation(str(path), steps=9), ("seed",), (("z", "last(qpos/ball/z)"),))

    def key(
        spec: StudySpec, names: tuple[str, ...] = ("seed", "opt.timestep"), values: tuple[str, ...] = ("1", ".01")
    ) -> str:
        return keys(spec, names, [values])[0]

    base = key(spec)
    assert key(spec) == base
    assert key(spec, ("opt.timestep", "seed"), (".01", "1")) == base  # in whatever order
    others = [key(spec, values=("2", ".01")), key(spec, names=("seed", "opt.density"))]
    others += [key(replace(spec, every=2)), key(replace(spec, metrics=(("z", "max(qpos/ball/z)"),)))]
    others += [key(replace(spec, base=replace(spec.base, steps=10)))]
    path.write_text(f"{BALL}<!-- a comment -->\n")
    assert key(spec) == base
    path.write_text(BALL.replace(".3", ".30"))  # another text, though it means the same
    others += [key(spec)]
    path.write_text(BALL.replace(".1", ".2"))
    others += [key(spec)]
    assert len({base, *others}) == 1 + len(others)


def test_the_key_of_a_point_changes_with_the_packages_of_its_policy_and_engine_but_not_with_the_folder_of_the_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = read_task(SCENES / "car_drive.yaml")
    folders = [tmp_path / name for name in ("a", "b")]
    for folder in folders:
        folder.mkdir()
        copy(SCENES / "policies" / "car_drive.onnx", folder)
        (folder / "drive.py").write_text("import yaml\ndef act(observation): return observation[:2]\n")

    def all_keys(folder: Path) -> list[str]:
        monkeypatch.delitem(sys.modules, "drive", raising=False)
        bases = [Simulation(task, policy=str(folder / name)) for name in ("car_drive.onnx", "drive.py:act")]
        specs = [
            StudySpec(base, ("seed",), (("R", "last(return)"),)) for base in [*bases, replace(bases[0], policy="zero")]
        ]
        return [keys(spec, ("seed",), [("1",)])[0] for spec in [*specs, replace(specs[2], engine="warp")]]

    before = all_keys(folders[0])
    assert len(set(before)) == 4
    assert all_keys(folders[1]) == before
    for changed, package in enumerate(("onnxruntime", "pyyaml", None, "mujoco_warp")):
        if package:
            monkeypatch.syspath_prepend(planted(tmp_path / package, package, "99.0"))
            after = all_keys(folders[0])
            assert [index for index in range(4) if after[index] != before[index]] == [changed]
            before = after


def test_environments_with_one_model_are_told_apart() -> None:
    names = ("gym:Hopper-v4", "gym:Hopper-v5", "gym:Hopper-v5?reset_noise_scale=0")
    specs = [StudySpec(Simulation(name, policy="zero"), ("seed",), (("R", "last(return)"),)) for name in names]
    assert len({keys(spec, ("seed",), [("1",)])[0] for spec in specs}) == 3
    assert len(set(keys(specs[0], ("model",), [(name,) for name in names]))) == 3


def test_a_part_that_would_fill_the_memory_is_refused(files: PartFiles, monkeypatch: pytest.MonkeyPatch) -> None:
    part = write(files, [0, 1], [RESULTS[0], RESULTS[0]])
    table = pyarrow.parquet.read_table(part)
    pyarrow.parquet.write_table(pyarrow.concat_tables([table] * 2**13), part, compression="zstd")
    assert read(files) == {0: "ok", 1: "ok"}
    monkeypatch.setattr("mjrun.decompression_limits.FREE", 2**20)
    with pytest.raises(FileError, match="would expand to"):
        read(files)
