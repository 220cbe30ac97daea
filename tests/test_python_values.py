"""Values of any type for every option of every public class: each is accepted, or refused with the option's name."""

import math
from contextlib import suppress
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import mjrun
from mjrun.errors import BadValueError, MjrunError, UsageError
from mjrun.options.option import Option, Options, options_of


class Column:
    """A value with comparisons that are neither true nor false, as a column of pandas."""

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        raise ValueError("the truth value is ambiguous")


VALUES = [
    *("text", "a=1", "", b"bytes", 7, 0.5, -1, 1j, True, None, math.nan, math.inf, len, object()),
    *([], ["a"], [1], [None], [[1]], (1, 2), {}, {"a": 1}, {"a": "b"}, {1: 2}, {"a": None}),
    *(Fraction(1, 3), Decimal("0.5")),
]
PENDULUM = mjrun.Simulation("scene:pendulum")
ARGUMENTS: dict[str, tuple[object, ...]] = {
    "Bench": ("scene:pendulum",),
    "Check": (["scene:pendulum"],),
    "Diff": ("a.csv", "b.csv"),
    "Evaluation": (mjrun.read_task("scene:car_drive"), "folder"),
    "Export": (PENDULUM, "a.glb"),
    "Fit": (PENDULUM,),
    "Image": (PENDULUM, "a.png"),
    "Keyframe": (PENDULUM, "a.xml"),
    "Plot": (PENDULUM, "a.png"),
    "Recording": (PENDULUM, "a.npz"),
    "Simulation": ("scene:pendulum",),
    "Dataset": (PENDULUM, "folder"),
    "EpisodeDataset": (PENDULUM, "folder"),
    "Study": (PENDULUM, "folder"),
    "TablePlot": ("a.csv",),
    "Trace": (PENDULUM,),
    "VariedPlot": (PENDULUM, "a.png"),
    "Video": (PENDULUM, "a.mp4"),
    "Viewer": (PENDULUM,),
}
REQUIRED: dict[str, dict[str, object]] = {
    "Plot": {"probe": "energy"},
    "VariedPlot": {"vary": "gravity=-9.81,-1.62"},
    "Observation": {"name": "a", "phase": 1},
    "Reward": {"value": "1"},
    "Termination": {"when": "time > 1", "as_": "failure"},
}
PUBLIC = [getattr(mjrun, name) for name in mjrun.__all__]
CLASSES = [value for value in PUBLIC if isinstance(value, type) and issubclass(value, Options)]
DECLARED = [pytest.param(cls, each, id=f"{cls.__name__}.{each.name}") for cls in CLASSES for each in options_of(cls)]


@pytest.mark.parametrize(("cls", "each"), DECLARED)
def test_a_value_of_any_type_is_accepted_or_refused_by_name(cls: type[Options], each: Option) -> None:
    arguments = ARGUMENTS.get(cls.__name__, ())
    if each.attribute == "output" and cls is not mjrun.Diff:
        arguments = arguments[:1]
    required = REQUIRED.get(cls.__name__, {})
    for value in [*VALUES, Column(), [Column()], {"a": Column()}]:
        with suppress(MjrunError):
            cls(*arguments, **{**required, each.attribute: value})


@pytest.mark.parametrize("cls", [mjrun.Video, mjrun.Image, mjrun.Trace, mjrun.Recording, mjrun.Study, mjrun.Fit])
def test_a_model_in_place_of_a_simulation_is_refused_with_what_to_write(cls: type) -> None:
    with pytest.raises(UsageError) as error:
        cls("scene:car", **({} if cls is mjrun.Fit else {"output": "output"}))
    assert str(error.value) == "simulation: 'scene:car' is not a simulation; write mjrun.Simulation('scene:car')"
    with pytest.raises(UsageError, match="'None' is not a simulation"):
        mjrun.Viewer(None)  # type: ignore[arg-type]


def test_controls_as_text_are_refused_with_what_is_accepted() -> None:
    with pytest.raises(BadValueError) as error:
        mjrun.Simulation("scene:car", ctrl="forward=1")  # type: ignore[arg-type]
    assert str(error.value) == "ctrl: 'forward=1' is not a mapping of names to numbers, as in {'hip': 0.3}"


def test_a_model_of_no_kind_is_refused() -> None:
    with pytest.raises(
        BadValueError, match="model: '5' is not the name or the path of a model, an MjModel, or a source"
    ):
        mjrun.Simulation(5).load()  # type: ignore[arg-type]


def test_a_controller_is_a_function_in_python() -> None:
    with pytest.raises(BadValueError, match=r"^controller: 'pd\.py:act' is not a function .*, not its name$"):
        mjrun.Simulation("scene:pendulum", controller="pd.py:act")  # type: ignore[arg-type]


def test_a_column_is_neither_a_camera_nor_a_time() -> None:
    for name in ("camera", "time"):
        with pytest.raises(BadValueError, match=rf"^{name}: .* is not a "):
            mjrun.Image(PENDULUM, "a.png", **{name: Column()})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("data", "kind"),
    [(mjrun.Table({"time": np.zeros(9)}), "Table"), ({"time": [0.0] * 9}, "dict"), (np.zeros((9, 2)), "list")],
)
def test_data_in_memory_are_refused_by_their_kind_with_a_remedy(data: object, kind: str) -> None:
    with pytest.raises(BadValueError) as error:
        mjrun.fit("scene:pendulum", data, free={"joint/hinge.damping": "0..1"})  # type: ignore[arg-type]
    assert (
        str(error.value) == f"data: '{kind}' is not the name of a file; write data that are in memory to a file first"
    )
    with pytest.raises(BadValueError, match=f"^output: '{kind}' is not the name of a file$"):
        mjrun.Video(PENDULUM, data)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["qpos", "qvel", "ctrl"])
@pytest.mark.parametrize("key", [0, None, ("hinge",)])
def test_names_that_are_not_text_are_refused(name: str, key: object) -> None:
    with pytest.raises(BadValueError, match=rf"^{name}: .* is not a mapping of names to numbers"):
        mjrun.Simulation("scene:pendulum", **{name: {key: 0.1}})  # type: ignore[arg-type]


@pytest.mark.parametrize("exact", [Fraction(1, 3), Decimal("0.3")])
def test_exact_numbers_are_those_of_floats(exact: Fraction | Decimal) -> None:
    for name in ("qpos", "qvel", "ctrl", "set"):
        for one, other in ((exact, float(exact)), ([exact, 1], [float(exact), 1])):
            values = [mjrun.Simulation("scene:pendulum", **{name: {"a": each}}) for each in (one, other)]  # type: ignore[arg-type]
            assert len({repr(getattr(each, name)) for each in values}) == 1


def test_read_table_takes_the_words_for_missing_cells(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("a,b\n1,2\n")
    with pytest.raises(BadValueError, match=r"^missing: 'zero' is not one of error, nan \(did"):
        mjrun.read_table(tmp_path / "t.csv", missing="zero")  # type: ignore[arg-type]
