import dataclasses
from dataclasses import field
from typing import Any, ClassVar

import numpy as np
import pytest

from mjrun.errors import BadValueError, UsageError
from mjrun.options.kinds import FlagKind, OneOrMoreKind, TextKind, optional
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind
from mjrun.options.option import (
    FrontEnd,
    Option,
    OptionExclusion,
    Options,
    exclusions_of,
    is_given,
    option,
    options,
    options_of,
    required,
)
from mjrun.options.setting_kinds import NamedNumbersKind
from mjrun.options.simulation import SimulationOptions


@options
class Common(Options):
    section: ClassVar[str] = "Common"

    subject: object = field(kw_only=False)
    quiet: bool = option(converter=FlagKind(), default=False, places=FrontEnd.COMMAND, help="Say nothing.")


@options
class Race(Common):
    section: ClassVar[str] = "Race"
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = (OptionExclusion(("laps", "length"), "both say how far"),)

    track: str = required(converter=TextKind(), kw_only=False, help="Where.")
    laps: int | None = option(converter=optional(IntegerKind(1)), default=None, help="How often.")
    length: object = option(converter=optional(ExactNumberKind()), default=None, help="How far [m].")
    weights: object = option(converter=NamedNumbersKind(), default={}, help="How heavy [kg].")
    assert_: tuple[str, ...] = option(converter=OneOrMoreKind(TextKind()), default=(), help="What must hold.")


def test_values_are_converted_checked_and_frozen() -> None:
    race = Race("cars", "oval", length="1/3", weights={"a": 2}, assert_="fast")
    assert (race.track, str(race.length), race.weights, race.assert_) == ("oval", "1/3", {"a": (2.0,)}, ("fast",))
    with pytest.raises(dataclasses.FrozenInstanceError):
        race.laps = 3  # type: ignore[misc]


@pytest.mark.parametrize("weight", [10**400, [1.0, 10**400]])
def test_a_number_too_large_for_floating_point_is_a_bad_value(weight: object) -> None:
    with pytest.raises(BadValueError, match=r"^weights: .* is not a mapping of names to numbers"):
        Race("cars", "oval", weights={"a": weight})


def test_a_bad_value_names_its_option_as_python_does() -> None:
    with pytest.raises(BadValueError, match=r"^laps: '0' is not a whole number of at least 1$") as error:
        Race("cars", "oval", laps=0)
    assert error.value.path == ("laps",)
    assert error.value.spelled(lambda name: f"--{name}").startswith("--laps: ")


def test_what_excludes_each_other_is_refused_at_the_second() -> None:
    with pytest.raises(UsageError, match=r"^laps and length exclude each other: both say how far$") as error:
        Race("cars", "oval", laps=1, length=2)
    assert error.value.path == ("length",)


@options
class Ride(Options):
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = (
        OptionExclusion(("laps", "length"), "a lap is long enough", when=("round", True)),
    )

    laps: int | None = option(converter=optional(IntegerKind(1)), default=None, help="How often.")
    length: object = option(converter=optional(ExactNumberKind()), default=None, help="How far [m].")
    round: bool = option(converter=FlagKind(), default=True, help="Back to the start.")


def test_what_excludes_each_other_may_do_so_in_one_case_alone() -> None:
    with pytest.raises(UsageError, match=r"^laps and length exclude each other: a lap is long enough$"):
        Ride(laps=1, length=2)
    assert Ride(laps=1, length=2, round=False).laps == 1


def test_options_are_listed_own_first_with_all_that_front_ends_need() -> None:
    assert [each.name for each in options_of(Race)] == ["track", "laps", "length", "weights", "assert", "quiet"]
    by_name: dict[str, Option] = {each.name: each for each in options_of(Race)}
    assert by_name["assert"].attribute == "assert_"
    assert by_name["track"].is_required
    assert not by_name["laps"].is_required
    assert (by_name["laps"].section, by_name["quiet"].section) == ("Race", "Common")
    assert by_name["quiet"].places == FrontEnd.COMMAND
    assert [exclusion.reason for exclusion in exclusions_of(Race)] == ["both say how far"]


def test_defaults_are_not_shared() -> None:
    first, second = Race("cars", "oval"), Race("cars", "oval")
    assert first.weights == {}
    assert first.weights is not second.weights


def test_what_is_given_is_other_than_the_default() -> None:
    race = Race("cars", "oval", laps=2)
    assert is_given(race, "laps")
    assert not is_given(race, "length")
    assert not is_given(race, "weights")
    assert is_given(race, "track")


def test_a_class_that_narrows_a_field_keeps_the_order_of_arguments() -> None:
    @options
    class CarRace(Race):
        subject: str = field(kw_only=False)

    assert CarRace("cars", "oval").subject == "cars"
    assert [each.name for each in options_of(CarRace)] == [each.name for each in options_of(Race)]


@pytest.mark.parametrize(
    ("values", "plain"),
    [
        ({"ctrl": {"motor": np.int64(3)}}, {"ctrl": {"motor": 3}}),
        ({"qvel": {"root": np.arange(3.0)}}, {"qvel": {"root": [0.0, 1.0, 2.0]}}),
        ({"qpos": {"root": [np.float32(0.5), 1]}}, {"qpos": {"root": [0.5, 1]}}),
        ({"qpos": {"hip": np.float32(0.5)}}, {"qpos": {"hip": 0.5}}),
        ({"steps": np.array(3)}, {"steps": 3}),
    ],
)
def test_numbers_of_numpy_are_those_of_python(values: dict[str, Any], plain: dict[str, Any]) -> None:
    assert SimulationOptions(**values) == SimulationOptions(**plain)
