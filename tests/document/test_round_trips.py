"""What an option's kind prints, documents read back as the same value, and their schema accepts it."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.document.builder import DocumentContext, OutputFolder
from mjrun.document.json_schema import printed
from mjrun.document.run import OUTPUTS
from mjrun.document.run_writer import plain_value
from mjrun.options import kinds, number_kinds, setting_kinds
from mjrun.options.diff import ColumnTolerancesKind
from mjrun.options.evaluation import EvaluationOptions, LowestValuesKind, VideoCountKind
from mjrun.options.fit import FitOptions
from mjrun.options.kinds import Kind
from mjrun.options.model import ServoGainsKind
from mjrun.options.option import document_options
from mjrun.options.policy import NormalizationKind, PolicyKind
from mjrun.options.schema_validation import Schema
from mjrun.options.setting_kinds import VariedSettingsKind
from mjrun.options.simulation import PushKind, SimulationOptions
from mjrun.options.sweep import StudyOptions
from mjrun.options.task import PARTS, LimitsKind, RandomValueKind, TaskOptions, TimedValuesKind, VectorOrKeyframeKind
from mjrun.rendering.visual import flags, frame_axes, groupings, labels
from tests.document.camera_strategies import decimals, events, names, numbers, positives, texts
from tests.document.schema_oracle import fits

PARTS_OF_TASKS = {key: declared for key, (_, declared) in PARTS.items()}
DECLARED = {
    "": SimulationOptions,
    "task": TaskOptions,
    "study": StudyOptions,
    "fit": FitOptions,
    "evaluation": EvaluationOptions,
    **OUTPUTS,
    **PARTS_OF_TASKS,
}
# Options of equal kinds are printed alike: the first of each has the name of the test.
EVERY_KIND = {
    repr(each.kind): pytest.param(each.kind, id=f"{where}-{each.name}")
    for where, declared in reversed(DECLARED.items())
    for each in document_options(declared)
}
NAMES = {"visual flag": flags(), "segmentation": [*groupings()], "frame": frame_axes(), "label": labels()}
FILES = st.sampled_from(["a.csv", "b/c.npz", "é x.yml.png"])
HERE = DocumentContext(Path(), OutputFolder(Path()))


def values(kind: Kind[Any, Any]) -> st.SearchStrategy[Any]:
    """Values of a kind, as Python gives them."""
    match kind:
        case kinds.OneOrMoreKind(each=each):
            return st.lists(values(each), min_size=1, max_size=3)
        case kinds.MujocoNameKind(of=of):
            return st.sampled_from(NAMES[of])
        case kinds.ChoiceKind(names=words):
            return st.sampled_from(words)
        case kinds.FlagKind():
            return st.booleans()
        case number_kinds.IntegerKind(least=least, most=most):
            return st.integers(1 - number_kinds.LIMIT if least is None else least, most or number_kinds.LIMIT - 1)
        case number_kinds.RealKind(least=least, above=above, most=most):
            low = least if above is None else above
            return st.floats(low, most, exclude_min=above is not None, allow_infinity=False)
        case number_kinds.ExactNumberKind() | number_kinds.InstantKind():
            exact = positives | decimals | st.fractions(Fraction(1, 10**6), 10**6)
            return exact | events if isinstance(kind, number_kinds.InstantKind) else exact
        case number_kinds.SizeKind():
            return st.tuples(st.integers(1, 9999), st.integers(1, 9999))
        case number_kinds.RangeKind():
            return st.tuples(st.floats(0, 1), st.floats(2, 3))
        case number_kinds.ProcessCountKind():
            return st.just("auto") | st.integers(1, 99)
        case number_kinds.GroupsKind():
            return st.lists(st.integers(0, 5), max_size=6) | st.sampled_from(["all", "none"])
        case kinds.NameOrIndexKind():
            return names | st.integers(0, 9)
        case kinds.PathKind():
            return FILES
        case ColumnTolerancesKind():
            least = st.floats(0, 1e9)
            return st.dictionaries(names, least | st.lists(least, min_size=1, max_size=2), max_size=3)
        case LowestValuesKind():
            return st.dictionaries(names, numbers, max_size=3)
        case setting_kinds.NamedNumbersKind():
            return st.dictionaries(names, numbers | st.lists(numbers, min_size=1, max_size=7), max_size=3)
        case setting_kinds.ColumnDefinitionsKind():
            pairs = st.dictionaries(st.sampled_from(["time", "qpos/a", "é"]), st.sampled_from(["t", "b * pi/180", "1"]))
            files = st.lists(st.sampled_from(["@a.map", "@b/c.txt", "time=t", "qpos/a=2*b"]), min_size=1, max_size=4)
            return pairs | files
        case VariedSettingsKind():
            spans = st.fixed_dictionaries(
                {"from": st.integers(0, 9), "to": st.integers(10, 99), "count": st.integers(2, 9)}
            )
            lists = st.lists(numbers | texts.filter(lambda text: ";" not in text), min_size=1, max_size=3)
            drawn = st.sampled_from([{"uniform": [0, 1]}, {"choice": ["a", "b"]}, "normal(0, 0.1)", "log:1..2:3"])
            return st.dictionaries(names, spans | lists | drawn | numbers, max_size=3)
        case RandomValueKind():
            return st.sampled_from(["uniform(-1, 1)", "normal(0, 0.01)"]) | numbers
        case VectorOrKeyframeKind():
            return numbers | st.lists(numbers, min_size=1, max_size=3) | names
        case LimitsKind():
            low, high = st.floats(-9, -1), st.floats(1, 9)
            return st.tuples(low, high) | st.tuples(st.lists(low, min_size=2, max_size=2), high)
        case TimedValuesKind():
            vector = st.lists(numbers, min_size=2, max_size=2)
            return st.tuples(vector, vector).map(lambda both: [[0, both[0]], [0.5, both[1]]])
        case number_kinds.NumberVectorKind():
            return numbers | st.lists(numbers, min_size=1, max_size=4)
        case setting_kinds.SettingsKind():
            return st.dictionaries(names, texts | numbers | st.booleans(), max_size=3)
        case kinds.GhostKind():
            return st.sampled_from(["offset=0/1/0,opacity=.3", "key=home", "trace=a.csv", ""])
        case PushKind():
            return st.sampled_from(
                ["torso=0/-1e2/.5@1/3+0.25", {"site": "a", "force": (1, 2, 3), "at": 0, "duration": 1}]
            )
        case VideoCountKind():
            return st.integers(0, 9) | st.just("failures")
        case PolicyKind():
            return st.sampled_from(["random", "zero", "a.onnx", "b/leapp"])
        case NormalizationKind():
            return st.sampled_from(["none", "a.npz"])
        case kinds.CameraKind():
            return st.sampled_from(["free", "top", "orbit:lookat=box", 2])
        case ServoGainsKind():
            return st.sampled_from(["auto", "kp=5", "kd=1e-3,kp=2"]) | st.just(True)
        case kinds.TextKind():
            return st.sampled_from(["energy", "qpos[left_*]", "12", "true", "a: b #c"])
    raise AssertionError(f"no values of {type(kind).__name__} are known")


@pytest.mark.parametrize("kind", EVERY_KIND.values())
@given(data=st.data())
@settings(max_examples=4, deadline=None)
def test_what_a_kind_prints_is_read_back_as_the_same_value(kind: Kind[Any, Any], data: st.DataObject) -> None:
    value = kind(data.draw(values(kind)))
    written = plain_value(kind, value)
    form = HERE.form(kind)
    definitions: dict[str, Schema] = {}
    rule = printed(form.schema(HERE, definitions))

    assert fits(written, rule, {"$defs": printed(definitions)})
    assert kind(form.read(written, HERE)) == value
