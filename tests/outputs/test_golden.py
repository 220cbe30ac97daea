"""A trace agrees with its golden table, or becomes it."""

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import mjrun
from mjrun import Simulation, Trace
from mjrun.diff.result import DiffResult, GoldenVersions
from mjrun.errors import (
    FailedAssertionError,
    FileError,
    GoldenDifferenceError,
    MjrunError,
    UnknownNameError,
    UnstableError,
    UsageError,
)
from mjrun.formats.table_reader import read_table
from mjrun.outputs.trace import TraceResult
from tests.diff.models import xml

GRAM = 0.001  # [kg]


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = Path("rig.xml")
    path.write_text(xml())
    return path


def test_of(model: Path, **how: Any) -> TraceResult:
    """A trace that is compared, and not written."""
    return Trace(Simulation(model, steps=50), written=False, **{"golden": "golden.csv", **how}).run()


def compared(result: TraceResult) -> DiffResult:
    """Its comparison with the golden table."""
    assert result.golden
    return result.golden


def facts(comparison: DiffResult) -> GoldenVersions:
    """What made the golden table."""
    assert comparison.golden
    return comparison.golden


test_of.__test__ = False  # type: ignore[attr-defined]


@pytest.mark.parametrize("suffix", [".csv", ".jsonl", ".npz", ".parquet", ".feather", ".mat"])
def test_what_is_made_agrees_with_itself_and_a_gram_does_not(model: Path, suffix: str) -> None:
    golden = f"golden{suffix}"
    made = test_of(model, golden=golden, update=True)
    assert made.path == ""
    assert made.golden
    assert (facts(made.golden).updated, made.golden.equal, made.golden.table) == (True, True, None)
    before = Path(golden).read_bytes()

    again = compared(test_of(model, golden=golden))
    assert (again.kind, again.a, again.b, again.equal) == ("golden", golden, str(model), True)
    assert facts(again).mjrun == facts(again).mjrun_now == mjrun.__version__
    assert facts(again).mujoco == facts(again).mujoco_now == mujoco.mj_versionString()

    model.write_text(xml().replace("8.907", str(8.907 + GRAM)))
    with pytest.raises(GoldenDifferenceError, match=r"rig\.xml differs from the golden table") as failure:
        test_of(model, golden=golden)
    (result,) = failure.value.results
    assert not compared(result).equal
    assert not facts(compared(result)).updated
    assert compared(result).notes == ["the model rig.xml, or a file that it refers to, has changed"]
    assert Path(golden).read_bytes() == before


def test_the_golden_table_is_the_trace_itself(model: Path) -> None:
    Trace(Simulation(model, steps=50), "trace.csv").run()
    test_of(model, update=True)
    assert Path("golden.csv").read_bytes() == Path("trace.csv").read_bytes()
    both = Trace(Simulation(model, steps=50), "again.csv", golden="golden.csv").run()
    assert both.path == "again.csv"
    assert Path("again.csv").read_bytes() == Path("trace.csv").read_bytes()


def test_differences_are_those_of_the_two_tables(model: Path) -> None:
    test_of(model, update=True)
    model.write_text(xml().replace("8.907", str(8.907 + GRAM)))
    Trace(Simulation(model, steps=50), "now.csv").run()
    golden, now = read_table("golden.csv"), read_table("now.csv")
    with pytest.raises(GoldenDifferenceError) as failure:
        test_of(model)
    table = failure.value.results[0].golden.table
    differing = {column.name for column in table.columns if column.first}
    assert differing == {name for name in now if not np.array_equal(golden[name], now[name])}
    largest = max(float(np.abs(golden[name] - now[name]).max()) for name in now)
    assert compared(test_of(model, atol=largest)).equal
    with pytest.raises(GoldenDifferenceError):
        test_of(model, atol=largest / 2)


def test_an_update_replaces_it_and_tells_what_changed(model: Path) -> None:
    test_of(model, update=True)
    model.write_text(xml().replace("8.907", str(8.907 + GRAM)))
    updated = compared(test_of(model, update=True))
    assert (updated.equal, facts(updated).updated) == (False, True)
    assert any("differs in" in sentence for sentence in updated.differences)
    assert compared(test_of(model)).equal


def test_an_update_may_replace_what_cannot_be_compared(model: Path) -> None:
    for text in ("", "\0"):
        Path("golden.csv").write_text(text)
        with pytest.raises(MjrunError):
            test_of(model)
        updated = compared(test_of(model, update=True))
        assert (len(updated.differences), facts(updated).updated) == (1, True)
        assert compared(test_of(model)).equal


def test_an_update_replaces_a_table_of_other_columns_only_if_a_manifest_belongs_to_it(model: Path) -> None:
    Path("golden.csv").write_text("time,other\n0,1\n")
    with pytest.raises(UsageError, match=r"nothing except time in common(.|\n)*update does not replace it: remove it"):
        test_of(model, update=True)
    assert Path("golden.csv").read_text() == "time,other\n0,1\n"
    Path("golden.csv").unlink()
    test_of(model, update=True, probe="qpos")
    assert facts(compared(test_of(model, update=True, probe="energy"))).updated


def test_an_update_replaces_the_table_of_a_model_that_was_changed_or_renamed_but_not_that_of_another(
    model: Path,
) -> None:
    test_of(model, update=True)
    renamed = model.rename("arm.xml")
    assert facts(compared(test_of(renamed, update=True))).updated
    renamed.write_text(xml().replace("8.907", str(8.907 + GRAM)))
    assert facts(compared(test_of(renamed, update=True))).updated
    files = {path: path.read_bytes() for path in Path().iterdir()}
    model.write_text(xml())
    for probe in ("energy", "time"):
        with pytest.raises(
            UsageError, match=r"made from another model: arm\.xml\nupdate does not replace it: remove it"
        ):
            test_of(model, update=True, probe=probe)
    assert {**files, model: model.read_bytes()} == {path: path.read_bytes() for path in Path().iterdir()}


def test_a_missing_one_is_not_made_by_itself(model: Path) -> None:
    with pytest.raises(FileError, match="does not exist\nupdate creates it from this simulation") as error:
        test_of(model)
    assert error.value.exit_code == 7
    assert not Path("golden.csv").exists()


def test_a_table_whose_manifest_cannot_be_written_leaves_nothing(model: Path) -> None:
    Path("golden.csv.json").mkdir()
    with pytest.raises(FileError, match=r"golden.csv.json: exists and is not a regular file"):
        test_of(model, update=True)
    assert sorted(path.name for path in Path().iterdir()) == ["golden.csv.json", "rig.xml"]


def test_nothing_is_updated_on_failure(model: Path) -> None:
    test_of(model, update=True)
    files = {path: path.read_bytes() for path in Path().iterdir()}
    with pytest.raises(FailedAssertionError):
        test_of(model, update=True, assert_="max(time) > 9", every=2)
    assert {path: path.read_bytes() for path in Path().iterdir()} == files

    shooting = Simulation(model, steps=50, set={"opt.gravity": "0,0,1e30"})
    for keep in (False, True):
        with pytest.raises(UnstableError):
            Trace(shooting, written=False, golden="golden.csv", update=True, keep_partial=keep).run()
    assert {path: path.read_bytes() for path in Path().iterdir()} == files


def test_both_verdicts_are_reported(model: Path) -> None:
    test_of(model, update=True)
    with pytest.raises(FailedAssertionError, match="assertion failed") as failure:
        test_of(model, assert_="max(time) > 9", every=2)
    assert any("differs from the golden table" in note for note in failure.value.__notes__)


def test_another_length_and_other_columns(model: Path) -> None:
    test_of(model, update=True)
    with pytest.raises(GoldenDifferenceError, match=r"9 rows are in .* only: the first is row 51") as failure:
        Trace(Simulation(model, steps=59), written=False, golden="golden.csv").run()
    assert failure.value.exit_code == 1
    with pytest.raises(GoldenDifferenceError, match=r"columns are in golden\.csv only"):
        test_of(model, probe="qpos")


def test_versions_that_are_not_those_of_today(model: Path) -> None:
    test_of(model, update=True)
    manifest = Path("golden.csv.json")
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | {"mjrun": "0.0.1", "mujoco": "3.1\x1b"}))
    result = compared(test_of(model))
    assert (facts(result).mjrun, facts(result).mujoco) == ("0.0.1", "3.1\x1b")
    model.write_text(xml().replace("8.907", "9"))
    with pytest.raises(GoldenDifferenceError, match=r"it was made by mjrun 0.0.1, MuJoCo 3.1\\x1b, this is mjrun"):
        test_of(model)
    manifest.unlink()
    with pytest.raises(GoldenDifferenceError, match="it was made by unknown versions"):
        test_of(model)


def test_options_without_a_golden_table_and_formats_that_none_can_have(model: Path) -> None:
    simulation = Simulation(model, steps=5)
    options: list[dict[str, Any]] = [{"update": True}, {"rtol": 1e-3}, {"tol": {"x": 1}}]
    for how in options:
        with pytest.raises(UsageError, match="requires golden, "):
            Trace(simulation, "a.csv", **how)
    with pytest.raises(UnknownNameError, match=r"no table format '\.txt'"):
        Trace(simulation, "a.csv", golden="golden.txt").run()
    assert not Path("a.csv").exists()


def test_a_golden_table_is_no_output_too(model: Path) -> None:
    test_of(model, update=True)
    for update in (False, True):
        with pytest.raises(UsageError, match="clashes with the"):
            Trace(Simulation(model, steps=5), "golden.csv", golden="golden.csv", update=update).run()
    simulation = Simulation(model, steps=50)
    twice = [Trace(simulation, written=False, golden="golden.csv") for _ in range(2)]
    assert all(compared(result).equal for result in mjrun.perform(twice))
