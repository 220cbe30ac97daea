"""Differences as sentences."""

from dataclasses import replace
from pathlib import Path

from mjrun.diff.models import compare_models
from mjrun.diff.result import (
    CellDifference,
    ColumnDifference,
    FieldDifference,
    ModelComparison,
    TableDifference,
    UnitDifference,
    UnmatchedObject,
    UnmatchedRows,
)
from mjrun.diff.sentences import model_lines, model_sentences, place, provenance_notes, shared_sentence, table_sentences
from mjrun.errors import flag, spelled
from mjrun.model.sources import parse_source
from tests.diff.models import CRATE, xml

NONE = UnmatchedRows(0, None, None)


def column(name: str, differing: int, cell: CellDifference | None) -> ColumnDifference:
    return ColumnDifference(name, "", 0, 0, differing, 1.0, 1.0, 0.0, cell, cell)


def test_every_difference_is_a_sentence() -> None:
    once = column("qpos/a\x1b", 1, CellDifference(3, 4, 0.25, "0.1", "0.2"))
    often = column("x", 7, CellDifference(1, 1, 0.0, "1.0", "nan"))
    table = TableDifference(
        aligned="time",
        rows=9,
        rows_a=12,
        rows_b=10,
        only_a=UnmatchedRows(3, 2, 0.125),
        only_b=UnmatchedRows(1, 10, 9.0),
        columns=[once, often, column("y", 0, None)],
        columns_only_a=["p"],
        columns_only_b=["q", "r"],
        units=[UnitDifference("z", "m", "mm")],
    )
    assert table_sentences(table, "A", "B") == [
        "1 column is in A only: p",
        "2 columns are in B only: q, r",
        "3 rows are in A only: the first is row 2, time 0.125 s",
        "1 row is in B only: row 10, time 9.0 s",
        "the unit of 'z' is m in A, mm in B",
        r"qpos/a\x1b differs in rows 3 and 4, time 0.25 s: 0.1, not 0.2",
        "x differs in 7 of 9 rows, first in row 1, time 0.0 s: 1.0, not nan",
    ]


def test_what_is_in_one_table_only_is_no_difference_of_what_both_have() -> None:
    table = TableDifference("time", 9, 12, 9, UnmatchedRows(3, 2, 0.125), NONE, [column("x", 0, None)], ["p"], [], [])
    assert table_sentences(table, "A", "B", common=True) == []
    assert table_sentences(replace(table, rows=0), "A", "B", "state", common=True) == ["no state exists in both"]
    assert shared_sentence(table) == ""
    assert spelled(shared_sentence(replace(table, shared_agree=True)), flag) == (
        "the 9 rows and 1 column that both have agree; --common compares only these"
    )


def test_a_text_is_in_quotes_and_a_row_has_its_key() -> None:
    cell = CellDifference(3, 1, None, "ok", "un\x1b", "mass = 2")
    text = ColumnDifference("status", "", 0, 0, 1, None, None, None, cell, cell, text=True)
    table = TableDifference("mass", 9, 9, 9, UnmatchedRows(1, 4, None, "mass = 3"), NONE, [text], [], [], [])
    assert table_sentences(table, "A", "B") == [
        "1 row is in A only: row 4, mass = 3",
        r"status differs in rows 3 and 1, mass = 2: 'ok', not 'un\x1b'",
    ]


def test_what_agrees_has_no_sentence() -> None:
    table = TableDifference("row", 1, 1, 1, NONE, NONE, [column("x", 0, None)], [], [], [])
    assert table_sentences(table, "A", "B") == []


def test_a_place_is_a_row_with_its_time_or_a_step() -> None:
    assert place(CellDifference(2, 2, None, "", ""), "row") == "row 2"
    assert place(CellDifference(2, 2, 7.0, "", ""), "step") == "step 7"


def result(*fields: FieldDifference, only_b: tuple[UnmatchedObject, ...] = ()) -> ModelComparison:
    return ModelComparison("a.xml", "b.xml", fields, [], [], only_b, [], [])


def lines(*fields: FieldDifference) -> list[str]:
    return [*model_lines(result(*fields))]


def test_values_have_as_many_digits_as_it_takes() -> None:
    mass = FieldDifference("body_mass", "torso", (), (8.907,), (9.0,), "kg")
    hair = FieldDifference("body_mass", "torso", (), (8.907,), (8.907000001,), "kg")
    assert lines(mass, hair) == ["body_mass[torso] 8.907 → 9 kg", "body_mass[torso] 8.907 → 8.907000001 kg"]


def test_components_words_and_rows() -> None:
    assert lines(
        FieldDifference("geom_friction", "floor", ("slide",), (1.0,), (0.5,)),
        FieldDifference("geom_pos", "box", (), (0.0, 0.0, 1.0), (0.0, 1.0, 2.0), "m"),
        FieldDifference("jnt_limited", "knee", (), (True,), (False,)),
        FieldDifference("opt.integrator", "", (), ("euler",), ("rk4",)),
        FieldDifference("name", "joint knee", (), ("knee",), ("",)),
    ) == [
        "geom_friction[floor].slide 1 → 0.5",
        "geom_pos[box] (0, 0, 1) → (0, 1, 2) m",
        "jnt_limited[knee] true → false",
        "opt.integrator euler → rk4",
        "name[joint knee] knee → ''",
    ]


def test_long_lists_are_cut() -> None:
    many = [FieldDifference("geom_group", f"g{i}", (), (0,), (1,)) for i in range(14)]
    assert lines(*many)[-2:] == ["geom_group[g9] 0 → 1", "… and 4 more like this"]
    assert len([*model_lines(result(*many), every=True)]) == 14
    pose = FieldDifference("key_qpos", "start", (), tuple(map(float, range(9))), (0.0,) * 9)
    assert lines(pose) == ["key_qpos[start] differs in 9 values, by 8 at most"]


def test_names_from_models_are_cleaned() -> None:
    text = [*model_lines(result(only_b=(UnmatchedObject("body", "\x1b[31m"),)))]
    assert text == ["only in b.xml: body \\x1b[31m"]


def test_the_whole_report(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(xml())
    (tmp_path / "b.xml").write_text(xml(CRATE).replace("8.907", "9"))
    a, b = (parse_source(str(tmp_path / name)) for name in ("a.xml", "b.xml"))
    report = compare_models(a, b)
    text = [*model_lines(report)]
    assert text[:2] == [
        "body_mass[torso] 8.907 → 9 kg",
        f"only in {b.text}: body crate; joint crate; geom lid",
    ]
    assert model_sentences(report) == text[:2]
    assert text[2].startswith("computed from these: ")
    assert "body_subtreemass (2)" in text[2]
    assert any(f"{a.text}:15 → {b.text}:15: <inertial" in line and '"8.907" → "9"' in line for line in text)


def test_models_that_agree(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(xml())
    (tmp_path / "b.xml").write_text(xml().replace("</worldbody>", '<frame name="f"/></worldbody>'))
    a, b = (parse_source(str(tmp_path / name)) for name in ("a.xml", "b.xml"))
    report = compare_models(a, b)
    assert len(report.xml) == 1
    assert [*model_lines(report)] == model_sentences(report) == []


MANIFEST = {"mjrun": "1", "mujoco": "4.0.0", "seed": 0, "model": {"path": "a.xml", "sha256": "aa"}, "command": "x"}


def test_what_differs_in_what_made_them_is_reported() -> None:
    other = {**MANIFEST, "mujoco": "4.0.1\x1b", "seed": 1, "model": {"sha256": "bb"}, "command": "y"}
    assert provenance_notes(MANIFEST, other) == [
        r"MuJoCo is 4.0.0 and 4.0.1\x1b",
        "the seed is 0 and 1",
        "the models, or their overrides, differ",
    ]
    same = provenance_notes({**MANIFEST, "physics": "p"}, {**other, "physics": "p"})
    assert same[-1] == "the models, or their overrides, differ; their physics is the same"


def test_the_model_that_differs_is_named_and_so_are_the_options_that_change_it() -> None:
    def made(path: str, sha256: str, **simulation: object) -> dict[str, object]:
        return {"model": {"path": path, "sha256": sha256}, "options": {"simulation": simulation}}

    assert provenance_notes(made("a.xml", "1"), made("b.xml", "2")) == ["the models a.xml and b.xml differ"]
    assert provenance_notes(made("a.xml", "1"), made("a.xml", "2")) == [
        "the model a.xml, or a file that it refers to, has changed"
    ]
    changed = provenance_notes(made("a.xml", "1", key=None, seed=0), made("a.xml", "2", key="home", seed=1))
    assert changed == [
        "the models, or their overrides, differ",
        "the option key is None and home",
    ]


def test_nothing_is_reported_of_what_is_not_known() -> None:
    assert provenance_notes(MANIFEST, MANIFEST) == []
    assert provenance_notes(MANIFEST, None) == provenance_notes({}, MANIFEST) == []
    assert provenance_notes({"model": 1, "mujoco": None}, {"model": "b", "mujoco": [1]}) == ["MuJoCo is None and [1]"]
