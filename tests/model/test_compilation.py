"""Theorems about compilation: a model that MuJoCo refuses is refused with its line, its reason and the overrides."""

from pathlib import Path

import pytest

from mjrun.errors import (
    BadValueError,
    BrokenModelError,
    MjrunError,
    ModelError,
    clean,
)
from mjrun.model.load import load
from tests.model.model_files import MODEL, write


def refusal(path: Path) -> ModelError:
    with pytest.raises(ModelError) as caught:
        load(path)
    assert caught.value.exit_code == 3
    return caught.value


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ('<mujoco>\n<worldbody>\n<geom siz="1"/>\n</worldbody></mujoco>', 3, "unrecognized attribute: 'siz'"),
        ('<mujoco>\n\n\n<worldbody><geom rgba="x" size="1"/></worldbody></mujoco>', 4, "'rgba'"),
        ('<mujoco>\n<worldbody>\n<geom name="x" size="0"/>\n</worldbody></mujoco>', 3, "size 0 must be positive"),
        ('<mujoco>\n<worldbody>\n\n<geom type="mesh" mesh="no"/>\n</worldbody></mujoco>', 4, "mesh 'no' not found"),
        ('<mujoco>\n<actuator>\n<motor joint="a"/>\n</actuator></mujoco>', 3, "unknown transmission target 'a'"),
        ("<mujoco>\n<worldbody></mujoco>", 2, "XML_ERROR_MISMATCHED_ELEMENT"),
        ('<mujoco>\n<worldbody>\n<body name="line 77"><freejoint/></body>\n</worldbody></mujoco>', 3, "mass"),
        ("hello", 1, "XML parse error"),
        ("", None, "empty file"),
        ('<mujoco><asset><mesh file="no.obj"/></asset></mujoco>', None, "no.obj"),
    ],
)
def test_a_broken_model_is_refused_with_the_line_and_mujocos_reason(
    tmp_path: Path, text: str, line: int | None, words: str
) -> None:
    path = write(tmp_path / "a.xml", text)
    error = refusal(path)
    assert isinstance(error, BrokenModelError)
    assert (error.path, error.line) == (path, line)
    first = str(error).splitlines()[0]
    assert first.startswith(f"{path}:{line}: " if line else f"{path}: ")
    assert words in first
    assert "Error: " not in first


@pytest.mark.parametrize("overrides", [{}, {"opt.cone": "elliptic"}, {"geom/skin.size": "1"}])
def test_a_name_in_latin_1_is_refused_with_the_cure_whatever_is_overridden(
    tmp_path: Path, overrides: dict[str, str]
) -> None:
    path = write(tmp_path / "a.xml", MODEL.replace("skin", "pé").encode("latin-1"))
    with pytest.raises(BrokenModelError, match="not UTF-8; save the file as UTF-8"):
        load(path, overrides=overrides)


@pytest.mark.parametrize("timestep", ["0", "-1", "nan", "inf"])
def test_a_timestep_that_cannot_be_is_refused_unless_it_is_overridden(tmp_path: Path, timestep: str) -> None:
    path = write(tmp_path / "a.xml", f'<mujoco><option timestep="{timestep}"/></mujoco>')
    first, second = str(refusal(path)).splitlines()
    assert first == f"{path}: its timestep is {timestep}, and must be positive and finite"
    assert second == "timestep overrides it"
    assert load(path, timestep=0.01).opt.timestep == 0.01
    assert load(path, overrides={"opt.timestep": "0.01"}).opt.timestep == 0.01


def test_a_timestep_after_which_no_time_can_be_told_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xml", '<mujoco><option timestep="1e308"/></mujoco>')
    assert "its timestep is 1e+308, and must be at most 1e+12 s" in str(refusal(path))


@pytest.mark.parametrize("timestep", [0.0, -0.01, float("nan"), float("inf"), 1e308])
def test_asking_for_a_timestep_that_cannot_be_is_wrong_usage(tmp_path: Path, timestep: float) -> None:
    path = write(tmp_path / "a.xml", MODEL)
    with pytest.raises(BadValueError) as caught:
        load(path, timestep=timestep)
    assert caught.value.exit_code == 2


def test_an_override_that_breaks_the_model_is_named_in_the_refusal(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xml", MODEL)
    with pytest.raises(BrokenModelError) as caught:
        load(path, overrides={"geom/skin.material": "gold"})
    assert str(caught.value).endswith("with set geom/skin.material=gold")


def test_foreign_text_in_an_override_cannot_steer_the_terminal(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xml", MODEL)
    with pytest.raises(MjrunError) as caught:
        load(path, overrides={"geom/skin.material": "\x1b[31m"})
    assert all(line == clean(line) for line in str(caught.value).splitlines())
