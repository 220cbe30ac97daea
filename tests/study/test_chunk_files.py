"""Parts on disk read back unchanged; keys change with everything that determines a result, and with nothing else."""

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pyarrow
import pyarrow.parquet
import pytest

from mjrun.errors import FileError
from mjrun.simulation.simulation import Simulation
from mjrun.study.chunk_files import ChunkFiles, point_keys, study_identity
from mjrun.study.spec import PointResult, StudySpec
from tests.study.models import BALL

RESULTS = [
    PointResult(0, "ok", (1.5, math.inf), 9, wall=0.1),
    PointResult(1, "crashed", (math.nan,) * 2, 0, 139, "ü\n", 1.0),
]


@pytest.mark.parametrize("name", ["study", os.fsdecode(b"caf\xe9")], ids=["plain", "not UTF-8"])
def test_results_read_back(tmp_path: Path, name: str) -> None:
    files = ChunkFiles(tmp_path / name, ["a", "b"])
    files.create()
    files.write(["k1", "k2"], RESULTS, "host")
    read = files.read()
    assert [str(replace(read[key], index=i)) for i, key in enumerate(("k1", "k2"))] == [*map(str, RESULTS)]
    assert ChunkFiles(tmp_path / name, ["a"]).read() == {}  # of a study with other metrics


@pytest.fixture
def files(tmp_path: Path) -> ChunkFiles:
    files = ChunkFiles(tmp_path, ["a", "b"])
    files.create()
    return files


def test_a_good_result_wins_over_a_failed_one(files: ChunkFiles) -> None:
    files.write(["k", "x"], [RESULTS[0], RESULTS[0]], "host")
    files.write(["k", "y"], [RESULTS[1], RESULTS[1]], "host")
    assert files.read()["k"].status == "ok"
    assert files.read()["y"].status == "crashed"


def test_a_damaged_part_is_named_and_other_files_are_passed_over(files: ChunkFiles, tmp_path: Path) -> None:
    pyarrow.parquet.write_table(pyarrow.table({"x": [1]}), tmp_path / "parts" / "mine.parquet")
    assert files.read() == {}
    files.write(["k"], RESULTS[:1], "host")
    (tmp_path / "parts" / "broken.parquet").write_text("x")
    (tmp_path / "parts" / "empty.parquet").touch()
    assert list(files.read()) == ["k"]
    assert [path.name for path in files.damaged] == ["broken.parquet", "empty.parquet"]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("status", ["\x1b[2J"]),
        ("status", [7]),
        ("key", [["k"]]),
        ("steps", ["many"]),
        ("steps", pyarrow.array([None], pyarrow.int64())),
        ("message", [1.5]),
        ("metric:a", ["much"]),
        ("metric:a", pyarrow.array([None], pyarrow.float64())),
        ("wall", ["long"]),
    ],
)
def test_rows_that_mjrun_never_writes_are_passed_over(
    files: ChunkFiles, tmp_path: Path, name: str, values: object
) -> None:
    files.write(["k"], RESULTS[:1], "host")
    (path,) = (tmp_path / "parts").iterdir()
    table = pyarrow.parquet.ParquetFile(path).read()
    table = table.set_column(table.column_names.index(name), name, pyarrow.array(values))
    pyarrow.parquet.write_table(table, path)
    assert files.read() == {}


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
    path.write_text(BALL.replace(".3", ".30"))  # another file, though it means the same
    others += [key(spec)]
    path.write_text(BALL.replace(".1", ".2"))
    others += [key(spec)]
    assert len({base, *others}) == 1 + len(others)


def test_environments_with_one_model_are_told_apart() -> None:
    names = ("gym:Hopper-v4", "gym:Hopper-v5", "gym:Hopper-v5?reset_noise_scale=0")
    specs = [StudySpec(Simulation(name, policy="zero"), ("seed",), (("R", "last(return)"),)) for name in names]
    assert len({keys(spec, ("seed",), [("1",)])[0] for spec in specs}) == 3
    assert len(set(keys(specs[0], ("model",), [(name,) for name in names]))) == 3


def test_a_part_that_would_fill_the_memory_is_refused(
    files: ChunkFiles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files.write(["k", "x"], [RESULTS[0], RESULTS[0]], "host")
    (part,) = tmp_path.rglob("*.parquet")
    table = pyarrow.parquet.read_table(part)
    pyarrow.parquet.write_table(pyarrow.concat_tables([table] * 2**13), part, compression="zstd")
    assert set(files.read()) == {"k", "x"}
    monkeypatch.setattr("mjrun.decompression_limits.FREE", 2**20)
    with pytest.raises(FileError, match="would expand to"):
        files.read()
