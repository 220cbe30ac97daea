"""Ramps, blends, and the shake of a hand-held camera."""

import dataclasses
import itertools
import math
from typing import Any, ClassVar

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.camera.rigs.rig import (
    BLENDS,
    EASINGS,
    BoundRig,
    EasedNumber,
    MujocoCameras,
    ObjectNameKind,
    RampKind,
    Rig,
    Shake,
    ShakeNoise,
    ShotBlend,
    blend_weight,
)
from mjrun.camera.script import RIGS, parse_camera
from mjrun.options.kinds import ChoiceKind, ReadingContext
from mjrun.options.option import option, options, options_of, required
from mjrun.options.rendering import RIG_EXAMPLES
from mjrun.options.schema_validation import SchemaViolationError

ROUNDING = 1e-15
shares = st.floats(0, 1)


@pytest.mark.parametrize("ease", EASINGS)
def test_every_easing_begins_at_0_and_ends_at_1(ease: str) -> None:
    assert EASINGS[ease](0) == 0
    assert EASINGS[ease](1) == 1


@given(st.sampled_from(sorted(EASINGS)), st.lists(shares, min_size=2, max_size=9))
def test_no_easing_ever_goes_back(ease: str, us: list[float]) -> None:
    values = [EASINGS[ease](u) for u in sorted(us)]
    assert all(a <= b + ROUNDING for a, b in itertools.pairwise(values))


@pytest.mark.parametrize(
    ("ease", "slopes"),
    [
        ("linear", (1, 1)),
        ("cosine", (0, 0)),
        ("smooth", (0, 0)),
        ("smoother", (0, 0)),
        ("in", (0, 2)),
        ("out", (2, 0)),
    ],
)
def test_an_easing_starts_and_stops_as_its_name_says(ease: str, slopes: tuple[float, float]) -> None:
    at, h = EASINGS[ease], 1e-6
    assert (at(h) / h, (1 - at(1 - h)) / h) == pytest.approx(slopes, abs=1e-5)


def test_the_smoother_of_two_has_no_jolt_either() -> None:
    assert EASINGS["smoother"](1e-4) < 1e-11  # of third order, where smooth is of second


@given(st.floats(-5, 5), st.floats(-5, 5), shares)
def test_a_ramp_goes_from_start_to_end(start: float, end: float, u: float) -> None:
    assert EasedNumber(start, end).at(u) == pytest.approx(start + (end - start) * u)
    cosine = start + (end - start) * (1 - math.cos(math.pi * u)) / 2
    assert EasedNumber(start, end, "cosine").at(u) == pytest.approx(cosine, abs=1e-12)
    assert EasedNumber.still(start).at(u) == start


@given(st.sampled_from(sorted(BLENDS)), st.floats(-2, 2), st.floats(0.1, 3))
def test_what_a_blend_gives_to_one_shot_it_takes_from_the_other(shape: str, since: float, width: float) -> None:
    blend = ShotBlend(shape, width)
    assert blend_weight(blend, since) + blend_weight(blend, -since) == pytest.approx(1)
    assert blend_weight(blend, 0) == pytest.approx(0.5)


@given(st.sampled_from(["cosine", "linear", "smooth"]), st.floats(0.1, 3), st.floats(1.0001, 9))
def test_a_blend_is_over_outside_its_window(shape: str, width: float, times: float) -> None:
    assert blend_weight(ShotBlend(shape, width), -times * width / 2) == 0
    assert blend_weight(ShotBlend(shape, width), times * width / 2) == 1


@given(st.floats(-5, 5))
def test_a_sigmoid_is_the_logistic_function_until_nothing_of_it_can_be_seen(since: float) -> None:
    blend = ShotBlend("sigmoid", 0.3)
    assert blend_weight(blend, since) == pytest.approx(1 / (1 + math.exp(-since / 0.3)))
    assert blend_weight(blend, -0.3 * 28) == 0
    assert blend_weight(blend, 0.3 * 28) == 1
    assert blend_weight(blend, -1e9) == 0


def test_a_cut_has_no_in_between_and_forgives_a_rounding() -> None:
    assert [blend_weight(None, since) for since in (-1, -1e-6, -1e-12, 0, 1)] == [0, 0, 1, 1, 1]


def tremble(shake: Shake, rate: float = 40, count: int = 40_000) -> np.ndarray:
    noise = ShakeNoise(shake)
    return np.array([noise.at(k / rate) for k in range(count)])


def test_a_tremor_has_the_deviation_and_the_band_that_it_promises() -> None:
    angles = tremble(Shake(angle=0.7, frequency=2.0, seed=3))
    assert angles.std(axis=0) == pytest.approx([0.7, 0.7], rel=0.02)
    assert angles.mean(axis=0) == pytest.approx([0, 0], abs=0.01)
    power = np.abs(np.fft.rfft(angles[:, 0] * np.hanning(len(angles)))) ** 2
    hertz = np.fft.rfftfreq(len(angles), 1 / 40)
    assert power[(hertz > 0.99) & (hertz < 3.01)].sum() > 0.9999 * power.sum()
    assert abs(np.corrcoef(angles.T)[0, 1]) < 0.05


def test_a_tremor_depends_on_seed_and_time_alone() -> None:
    one, other = ShakeNoise(Shake(seed=1)), ShakeNoise(Shake(seed=2))
    forward = [one.at(t) for t in (0.0, 0.5, 1.0)]
    backward = [ShakeNoise(Shake(seed=1)).at(t) for t in (1.0, 0.5, 0.0)]
    assert np.array_equal(forward, backward[::-1])
    assert not np.allclose(one.at(0.5), other.at(0.5))


MODEL = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body name='box'><geom size='.1'/></body></worldbody></mujoco>"
)


@options
class CraneRig(Rig):
    """On the arm of a crane."""

    kind: ClassVar[str] = "crane"
    help: ClassVar[str] = "On a crane."

    base: str = required(converter=ObjectNameKind(), kw_only=False, help="What it stands on.")
    height: EasedNumber = option(
        converter=RampKind("metres", positive=True), default=2, key="up", kw_only=False, help="Its height [m]."
    )
    arm: str = option(converter=ChoiceKind(("long", "short")), default="long", kw_only=False, help="Its arm.")

    def bind(self, cameras: MujocoCameras, where: str) -> BoundRig:
        raise NotImplementedError


@pytest.mark.parametrize("rig", RIGS.values())
def test_every_field_of_every_rig_is_declared_with_a_sentence(rig: Any) -> None:
    declared = options_of(rig)
    assert [each.attribute for each in declared] == [field.name for field in dataclasses.fields(rig)]
    assert all(each.help.endswith(".") for each in declared)


def test_a_new_rig_has_its_form_from_its_declaration() -> None:
    form = CraneRig.form()
    value = {"base": "box", "up": {"from": 1, "to": 2}, "arm": "short"}
    rig = CraneRig("box", EasedNumber(1, 2), "short")
    assert form.read(value, ReadingContext()) == rig
    assert form.plain(rig) == value
    assert form.read({"base": "box", "up": 3}, ReadingContext()) == CraneRig("box", EasedNumber.still(3))
    definitions: dict[str, Any] = {}
    assert form.schema(ReadingContext(), definitions) == {"$ref": "#/$defs/Crane"}
    assert definitions["Crane"]["description"] == "On the arm of a crane."
    assert definitions["Crane"]["properties"]["up"]["description"] == "Its height [m]."
    assert definitions["Crane"]["properties"]["arm"]["enum"] == ["long", "short"]


@pytest.mark.parametrize("value", [{"up": 0}, {"up": {"from": 1, "to": -1}}, {"arm": "none"}, {"height": 1}])
def test_what_is_not_as_declared_is_refused(value: dict[str, object]) -> None:
    with pytest.raises(SchemaViolationError):
        CraneRig.form().read({"base": "box", **value}, ReadingContext())


def test_a_new_rig_has_its_argument_from_its_declaration(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(RIGS, "crane", CraneRig)
    monkeypatch.setitem(RIG_EXAMPLES, "crane", "crane:box")
    shot = parse_camera("crane:box,up=1..3,roll=4", MODEL).shots[0]
    assert shot.rig == CraneRig("box", EasedNumber(1, 3))
    assert shot.roll == EasedNumber(4, 4)
