"""What may be free, and how it is written."""

import math
from pathlib import Path

import pytest

from mjrun.errors import UsageError
from mjrun.fitting.free_parameter import FreeParameter, free_parameters, overrides, require_effect
from mjrun.model.sources import parse_source
from tests.cases import cases
from tests.fitting.logs import NOMINAL, write_model

SERVO = """<mujoco><worldbody><body name="a"><joint name="j"/><geom name="g" size=".1"/></body></worldbody>
<actuator><position name="servo" joint="j" kp="30" kv="2"/></actuator></mujoco>"""


@pytest.mark.parametrize("is_log", [False, True])
def test_a_coordinate_goes_from_bound_to_bound(is_log: bool) -> None:
    parameter = FreeParameter("joint/hinge.damping", 0.01, 1.0, 0.1, is_log)
    assert parameter.value(0) == pytest.approx(0.01)
    assert parameter.value(1) == pytest.approx(1.0)
    assert parameter.value(0.5) == pytest.approx(0.1 if is_log else 0.505)
    assert parameter.value(parameter.coordinate(0.37)) == pytest.approx(0.37, rel=1e-12)


def test_a_start_is_what_the_model_has_and_off_the_bounds(tmp_path: Path) -> None:
    source = parse_source(str(write_model(tmp_path)))
    texts = [("joint/hinge.damping", "0.3..1"), ("scale:geom/*.mass", "0.5..2"), ("delay:ctrl/motor", "0..0.1")]
    damping, mass, delay = free_parameters(texts, source, ["ctrl/motor"])
    assert (damping.start, mass.start, delay.start) == (NOMINAL["damping"], 1.0, 0.0)
    assert 0 < damping.first_coordinate < 0.1
    assert delay.first_coordinate > 0
    assert delay.is_delay
    assert overrides([delay], [0.1]) == []
    assert [each.unit(source.load()) for each in (damping, mass, delay)] == ["N·m·s/rad", "", "s"]


def test_a_gain_of_a_servo_is_what_its_attribute_is(tmp_path: Path) -> None:
    (tmp_path / "servo.xml").write_text(SERVO)
    source = parse_source(str(tmp_path / "servo.xml"))
    kp, kv = free_parameters([("actuator/servo.kp", "1..100"), ("actuator/servo.kv", "log:.1..10")], source, [])
    assert (kp.start, kv.start) == (30, 2)
    (tmp_path / "servo.xml").write_text(SERVO.replace('kp="30"', 'kp="44"').replace('kv="2"', 'kv="7"'))
    expected = parse_source(str(tmp_path / "servo.xml")).load()
    (tmp_path / "servo.xml").write_text(SERVO)
    model = parse_source(str(tmp_path / "servo.xml"), overrides([kp, kv], [44, 7])).load()
    assert model.actuator_gainprm.tolist() == expected.actuator_gainprm.tolist()
    assert model.actuator_biasprm.tolist() == expected.actuator_biasprm.tolist()


def test_a_prior_is_where_a_fit_begins(tmp_path: Path) -> None:
    source = parse_source(str(write_model(tmp_path)))
    (parameter,) = free_parameters([("joint/hinge.damping", "log:1e-3..1~normal(0.05, 0.01)")], source, [])
    assert (parameter.prior, parameter.start, parameter.is_log) == ((0.05, 0.01), NOMINAL["damping"], True)
    assert parameter.value(parameter.first_coordinate) == pytest.approx(0.05)
    assert parameter.coordinate(math.sqrt(1e-3)) == pytest.approx(0.5)


def test_what_a_wildcard_ties_is_reported_by_name(tmp_path: Path) -> None:
    bodies = '<body><freejoint name="root"/><geom size="1"/><body><joint name="left"/><geom size="1"/></body></body>'
    (tmp_path / "model.xml").write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    source = parse_source(str(tmp_path / "model.xml"))
    every, one = free_parameters([("joint/*.damping", "0..1"), ("joint/left.armature", "0..1")], source, [])
    assert every.sharing == "joint/*.damping is a single number, shared by root, left"
    assert one.sharing == ""


def test_a_delay_with_a_wildcard_is_one_of_all_its_columns(tmp_path: Path) -> None:
    source, columns = parse_source(str(write_model(tmp_path))), ["qpos/hinge", "ctrl/motor", "ctrl/brake"]
    (delay,) = free_parameters([("delay:ctrl/*", "0..0.1")], source, columns)
    assert delay.delayed == ("ctrl/motor", "ctrl/brake")
    assert delay.sharing == "delay:ctrl/* is a single number, shared by ctrl/motor, ctrl/brake"
    with pytest.raises(UsageError, match="is given twice"):
        free_parameters([("delay:ctrl/*", "0..0.1"), ("delay:ctrl/brake", "0..0.1")], source, columns)


@cases("path, text, message")
def test_what_cannot_be_free_is_refused(tmp_path: Path, path: str, text: str, message: str) -> None:
    source = parse_source(str(write_model(tmp_path)))
    with pytest.raises(UsageError, match=message):
        require_effect(free_parameters([(path, text)], source, ["ctrl/motor"])[0], source)


def test_what_the_compiler_computes_is_refused_with_the_objects_that_lack_it(tmp_path: Path) -> None:
    geoms = '<geom name="bob" size=".1" mass="1"/><geom name="rod" size=".1"/>'
    (tmp_path / "model.xml").write_text(f"<mujoco><worldbody><body><joint/>{geoms}</body></worldbody></mujoco>")
    source = parse_source(str(tmp_path / "model.xml"))
    assert free_parameters([("geom/bob.mass", "0.5..2")], source, [])[0].start == 1
    with pytest.raises(
        UsageError, match=r"geom/\*\.mass is not in the source of rod, since .*\nfree objects that spec"
    ):
        free_parameters([("geom/*.mass", "0.5..2")], source, [])


def test_what_makes_no_difference_or_does_not_compile_is_refused(tmp_path: Path) -> None:
    source = parse_source(str(write_model(tmp_path)))
    for text, message in (
        (("geom/rod.rgba[0]", "0..1"), "does not affect the physics"),
        (("geom/rod.mass", "-1..1"), "compile"),
    ):
        (parameter,) = free_parameters([text], source, [])
        with pytest.raises(UsageError, match=message):
            require_effect(parameter, source)


def test_something_must_be_free_and_once(tmp_path: Path) -> None:
    source = parse_source(str(write_model(tmp_path)))
    with pytest.raises(UsageError, match="nothing to fit"):
        free_parameters([], source, [])
    with pytest.raises(UsageError, match="twice"):
        free_parameters([("joint/hinge.damping", "0..1")] * 2, source, [])
