"""Values of options drawn by chance, made from the declarations of all options: what documents and Python write."""

from collections.abc import Collection
from contextlib import suppress
from functools import partial
from typing import Any

import yaml
from hypothesis import strategies as st

from mjrun.options.diff import ColumnTolerancesKind
from mjrun.options.kinds import (
    AnyKind,
    CameraKind,
    ChoiceKind,
    FlagKind,
    GhostKind,
    MujocoNameKind,
    NameOrIndexKind,
    OneOrMoreKind,
    PathKind,
    TextKind,
)
from mjrun.options.model import ServoGainsKind
from mjrun.options.number_kinds import (
    LIMIT,
    ExactNumberKind,
    GroupsKind,
    InstantKind,
    IntegerKind,
    NumberVectorKind,
    ProcessCountKind,
    RangeKind,
    RealKind,
    SizeKind,
)
from mjrun.options.option import FrontEnd, Options, options_of
from mjrun.options.policy import NormalizationKind, PolicyKind
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.setting_kinds import ColumnDefinitionsKind, NamedNumbersKind, SettingsKind, VariedSettingsKind
from mjrun.options.simulation import PushKind
from mjrun.options.task import LimitsKind, RandomValueKind, TimedValuesKind, VectorOrKeyframeKind
from mjrun.rendering.visual import flags
from tests.document.camera_strategies import names, numbers, positives, texts

SUFFIXES = {"contacts": ".csv", "golden": ".csv", "html": ".html", "pointcloud": ".ply"}
PUSH = {"force": [1, 2.5, 0], "at": 1, "duration": "1/3"}
MANY = st.lists(numbers, min_size=1, max_size=7)
PLAIN = texts.filter(lambda text: not text.lower().endswith((".yaml", ".yml")) and bool(text.strip(" ,")))
EXACT = st.integers(1, 2**60) | positives | st.sampled_from(["30000/1001", "1e2", "1/3", 0.1])
VARIED = st.sampled_from(["uniform(0, 1)", {"normal": [0, 1]}, "1..5:5", "log:1..2:3", "true,false", [1, 2], "a b"])
SETTING = st.sampled_from([0.5, True, -3, "elliptic", "1e-3", "0,up", [0, 0, -1.6]])


def values_of(kind: AnyKind, written: st.SearchStrategy[str]) -> st.SearchStrategy[Any]:
    """Returns values of a kind; `written` are the files that it may write."""
    match kind:
        case OneOrMoreKind():
            one = values_of(kind.each, written)
            return one | st.lists(one, min_size=1, max_size=3, unique_by=str)
        case PathKind():
            return written if kind.written else PLAIN
        case ChoiceKind():
            return st.sampled_from(kind.names)
        case FlagKind():
            return st.booleans()
        case IntegerKind():
            return st.integers(kind.least or 0, kind.most or LIMIT - 1)
        case RealKind():
            return st.floats(kind.above or kind.least or 0.0, kind.most or 1e9, exclude_min=kind.above is not None)
        case MujocoNameKind():
            return st.sampled_from([*flags()] if kind.of == "visual flag" else ["body", "geom"])
        case _:
            return next(values for cls, values in PLAIN_VALUES if isinstance(kind, cls))


PLAIN_VALUES: list[tuple[type[AnyKind], st.SearchStrategy[Any]]] = [
    (PushKind, st.sampled_from(["torso=0/-1e2/.5@1/3+0.25", {**PUSH, "body": "a"}, {**PUSH, "site": "b"}])),
    (GhostKind, st.sampled_from(["offset=0/1/0,opacity=.3", "key=home", "trace=a.csv", "recording=r.npz"])),
    (ServoGainsKind, st.sampled_from([True, "auto", "kp=50,kd=2"])),
    (PolicyKind, st.sampled_from(["zero", "random", "p.onnx"])),
    (NormalizationKind, st.sampled_from(["none", "n.json"])),
    (ColumnTolerancesKind, st.dictionaries(names, positives | st.lists(positives, min_size=2, max_size=2), max_size=3)),
    (ColumnDefinitionsKind, st.dictionaries(st.sampled_from(["time", "qpos/a"]), st.just("t/1e3") | positives)),
    (VariedSettingsKind, st.dictionaries(names, SETTING | VARIED, max_size=3)),
    (SettingsKind, st.dictionaries(names, SETTING, max_size=3)),
    (NamedNumbersKind, st.dictionaries(names, numbers | MANY, max_size=3)),
    (SizeKind, st.lists(st.integers(50, 9000), min_size=2, max_size=2)),
    (RangeKind, st.tuples(st.floats(0, 1), st.floats(2, 3)).map(list)),
    (GroupsKind, st.lists(st.integers(0, 5), max_size=6) | st.sampled_from(["all", "none"])),
    (NumberVectorKind, numbers | MANY),
    (LimitsKind, st.sampled_from([[-1, 1], [[-1, -2], 3]])),
    (VectorOrKeyframeKind, numbers | MANY | names),
    (RandomValueKind, st.sampled_from([0.5, "uniform(0, 1)", {"normal": [0, 0.1]}])),
    (TimedValuesKind, st.sampled_from([[[0, [1, 0]], [2.5, [0, 1]]], [[0, [1]]]])),
    (ProcessCountKind, st.just("auto") | st.integers(1, 99)),
    (ExactNumberKind, EXACT),
    (InstantKind, EXACT),
    (NameOrIndexKind, names | st.integers(0, 9)),
    (CameraKind, PLAIN),
    (TextKind, PLAIN),
]


def options_in_documents(
    cls: type[Options], prefix: str = "", without: Collection[str] = (), always: Collection[str] = ()
) -> st.SearchStrategy[dict[str, Any]]:
    """Returns values of some options of a class that go together, and of some always.

    The names of files that it writes begin with the prefix.
    """

    def together(drawn: dict[str, Any]) -> dict[str, Any]:
        made = {name: kinds[name](value) for name, value in drawn.items()}
        while left := {path[0] for path, _ in (*cls.conflicts(made), *cls.unmet_requirements(made))} & made.keys():
            made = {name: value for name, value in made.items() if name not in left}
        return {name: drawn[name] for name in made}

    declared = [each for each in options_of(cls) if FrontEnd.DOCUMENT in each.places]
    kinds = {each.name: each.kind for each in declared if each.name not in ("output", *without)}

    def accepted(kind: AnyKind, value: object) -> bool:
        with suppress(InvalidValueError):
            kind(value)
            return True
        return False

    some = {
        name: values_of(kind, st.just(f"{prefix}{name}{SUFFIXES.get(name, '.o')}")).filter(partial(accepted, kind))
        for name, kind in kinds.items()
    }
    needed = {name: some.pop(name) for name in always}
    return st.fixed_dictionaries(needed, optional=some).map(together)


def in_python(cls: type[Options], options: dict[str, Any], folder: str = "") -> dict[str, Any]:
    """Returns arguments of Python's call for options of a document, whose outputs are in the folder."""
    declared = {each.name: each for each in options_of(cls)}
    return {
        declared[name].attribute: f"{folder}{value}" if getattr(declared[name].kind, "written", False) else value
        for name, value in options.items()
    }


class QuotingDumper(yaml.SafeDumper):
    """A writer of YAML that puts every text in quotes."""

    def ignore_aliases(self, data: object) -> bool:
        """Writes each value where it is."""
        return True


QuotingDumper.add_representer(
    str, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"')
)


def in_quotes(document: dict[str, Any]) -> str:
    """Returns a document with quotes around every text, in which no variable is meant."""
    return yaml.dump(document, Dumper=QuotingDumper, sort_keys=False).replace("${", "$${")
