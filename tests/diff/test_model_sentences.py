"""The differences of two models as people read them."""

from pathlib import Path

from mjrun.diff.model_differences import FieldDifference, ModelComparison, ModelObject
from mjrun.diff.model_sentences import model_lines, model_sentences
from mjrun.diff.models import compare_models
from mjrun.model.sources import parse_source
from tests.diff.models import CRATE, xml


def result(*fields: FieldDifference, only_b: tuple[ModelObject, ...] = ()) -> ModelComparison:
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
    text = [*model_lines(result(only_b=(ModelObject("body", "\x1b[31m"),)))]
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
