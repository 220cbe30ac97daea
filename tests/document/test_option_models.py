"""What an option's kind prints, documents read back as the same value, and their schema accepts it."""

from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from mjrun.document.json_schema import json_schema
from mjrun.document.option_models import option_value, options_model
from mjrun.document.output_folder import Folders, OutputFolder
from mjrun.document.run import OUTPUTS, RunDocument
from mjrun.document.run_writer import plain_value
from mjrun.options import kinds
from mjrun.options.diff import ColumnTolerances
from mjrun.options.kinds import Kind
from mjrun.options.option import Exclusion, Option, Options, document_options, option, options, required
from mjrun.options.policy import NormalizationKind, PolicyKind
from mjrun.options.push import PushKind
from mjrun.options.simulation import SimulationOptions
from mjrun.rendering.segmentation import groupings
from mjrun.rendering.visual import flags, frames, labels
from tests.document.camera_strategies import decimals, events, names, numbers, positives, texts
from tests.document.schema_oracle import fits

EVERY_OPTION = [
    pytest.param(key, each, id=f"{key}-{each.name}")
    for key, declared in {"": SimulationOptions, **OUTPUTS}.items()
    for each in document_options(declared)
]
NAMES = {"visual flag": flags(), "segmentation": [*groupings()], "frame": frames(), "label": labels()}
FILES = st.sampled_from(["a.csv", "b/c.npz", "é x.yml.png"])
HERE = Folders(Path(), OutputFolder(Path()))


def values(kind: Kind[Any, Any]) -> st.SearchStrategy[Any]:
    """Values of a kind, as Python gives them."""
    match kind:
        case kinds.Optional(each=each):
            return values(each)
        case kinds.Several(each=each):
            return st.lists(values(each), min_size=1, max_size=3)
        case kinds.MujocoName(of=of):
            return st.sampled_from(NAMES[of])
        case kinds.Choice(names=words):
            return st.sampled_from(words)
        case kinds.Flag():
            return st.booleans()
        case kinds.Integer(least=least, most=most):
            return st.integers(least, most)
        case kinds.Real(least=least, above=above, most=most):
            low = least if above is None else above
            return st.floats(low, most, exclude_min=above is not None, allow_infinity=False)
        case kinds.ExactNumber() | kinds.Instant():
            exact = positives | decimals | st.fractions(Fraction(1, 10**6), 10**6)
            return exact | events if isinstance(kind, kinds.Instant) else exact
        case kinds.Size():
            return st.tuples(st.integers(1, 9999), st.integers(1, 9999))
        case kinds.Range():
            return st.tuples(st.floats(0, 1), st.floats(2, 3))
        case kinds.Processes():
            return st.just("auto") | st.integers(1, 99)
        case kinds.Groups():
            return st.lists(st.integers(0, 5), max_size=6) | st.sampled_from(["all", "none"])
        case kinds.Key():
            return names | st.integers(0, 9)
        case kinds.File():
            return FILES
        case ColumnTolerances():
            least = st.floats(0, 1e9)
            return st.dictionaries(names, least | st.lists(least, min_size=1, max_size=2), max_size=3)
        case kinds.Values():
            return st.dictionaries(names, numbers | st.lists(numbers, min_size=1, max_size=7), max_size=3)
        case kinds.ColumnMap():
            pairs = st.dictionaries(st.sampled_from(["time", "qpos/a", "é"]), st.sampled_from(["t", "b * pi/180", "1"]))
            files = st.lists(st.sampled_from(["@a.map", "@b/c.txt", "time=t", "qpos/a=2*b"]), min_size=1, max_size=4)
            return pairs | files
        case kinds.Settings():
            return st.dictionaries(names, texts | numbers | st.booleans(), max_size=3)
        case kinds.Ghost():
            return st.sampled_from(["offset=0/1/0,opacity=.3", "key=home", "trace=a.csv", ""])
        case PushKind():
            return st.sampled_from(
                ["torso=0/-1e2/.5@1/3+0.25", {"site": "a", "force": (1, 2, 3), "at": 0, "duration": 1}]
            )
        case PolicyKind():
            return st.sampled_from(["random", "zero", "a.onnx", "b/leapp"])
        case NormalizationKind():
            return st.sampled_from(["none", "a.npz"])
        case kinds.Camera():
            return st.sampled_from(["free", "top", "orbit:lookat=box", 2])
        case kinds.Text():
            return st.sampled_from(["energy", "qpos[left_*]", "12", "true", "a: b #c"])
    raise AssertionError(f"no values of {type(kind).__name__} are known")


@cache
def run_schema() -> dict[str, Any]:
    return json_schema("run")


@pytest.mark.parametrize(("key", "each"), EVERY_OPTION)
@given(data=st.data())
@settings(max_examples=15, deadline=None)
def test_what_a_kind_prints_is_read_back_as_the_same_value(key: str, each: Option, data: st.DataObject) -> None:
    value = each.kind(data.draw(values(each.kind)))
    written = plain_value(each.kind, value)
    least = {"output": "o.mp4", **({"probe": "energy"} if key == "plots" else {})}
    document: dict[str, Any] = {"model": "m.xml", "recordings": ["r.npz"]}
    document |= {key: [{**least, each.name: written}]} if key else {each.name: written}

    assert fits(document, run_schema(), run_schema())
    model = RunDocument.model_validate(document)
    entry = getattr(model, key)[-1] if key else model
    read = option_value(each, getattr(entry, each.attribute), HERE)
    assert each.kind(read) == value


@options
class Toaster(Options):
    """A toaster."""

    exclusions = (Exclusion(("slices", "bagel"), "there is one slot"),)

    heat: float = required(converter=kinds.Real(above=0.0, most=9.0), help="How hot.")
    slices: int = option(converter=kinds.Integer(1), default=2, help="How many.")
    bagel: bool = option(converter=kinds.Flag(), default=False, help="Toast one side.")
    assert_: str | None = option(converter=kinds.Optional(kinds.Text()), default=None, usual="nothing", help="A claim.")


def test_a_declaration_alone_makes_a_model() -> None:
    model = options_model(Toaster)
    toaster = model.model_validate({"heat": 3, "assert": "warm"})
    assert toaster.model_dump() == {"heat": 3.0, "slices": 2, "bagel": False, "assert_": "warm"}
    assert toaster.model_fields_set == {"heat", "assert_"}
    schema = model.model_json_schema()
    assert schema["description"] == "A toaster."
    assert schema["required"] == ["heat"]
    heat = {"description": "How hot.", "exclusiveMinimum": 0.0, "maximum": 9.0, "type": "number"}
    assert schema["properties"]["heat"].items() >= heat.items()
    assert schema["properties"]["assert"]["description"] == "A claim. If left out: nothing."


@pytest.mark.parametrize(
    ("value", "places"),
    [
        ({}, [("heat",)]),
        ({"heat": 0}, [("heat",)]),
        ({"heat": 10}, [("heat",)]),
        ({"heat": 1, "slices": 0}, [("slices",)]),
        ({"heat": 1, "assert_": "warm"}, [("assert_",)]),
        ({"heat": 1, "slices": 3, "bagel": True}, [("bagel",)]),
        ({"heat": -1, "slices": 3, "bagel": True}, [("bagel",), ("heat",)]),
    ],
)
def test_what_a_declaration_forbids_is_refused(value: dict[str, Any], places: list[tuple[str, ...]]) -> None:
    with pytest.raises(ValidationError) as caught:
        options_model(Toaster).model_validate(value)
    assert sorted(error["loc"] for error in caught.value.errors()) == places


def test_an_exclusion_concerns_what_is_said_only() -> None:
    assert options_model(Toaster).model_validate({"heat": 1, "slices": 3, "bagel": False})
