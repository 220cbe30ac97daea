"""The figures of a benchmark that are compared, and their samples."""

from typing import Any

import pytest

from mjrun.bench.baseline import FigureSamples, figures

STEP, WORKLOAD = {"samples": [2.0, 4.0, 6.0]}, {"samples": [1.0, 2.0, 1.0]}


def row(**changed: Any) -> dict[str, Any]:
    return {"point": {}, "step": STEP, "threads": [], **changed}


def frame(**changed: Any) -> dict[str, Any]:
    return {
        "view": "depth",
        "size": [64, 48],
        "quality": "high",
        "renderer": "classic",
        "device": "a GPU",
        "total": STEP,
        **changed,
    }


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        ({"rows": [row()], "frames": []}, [("step", "")]),
        ({"rows": [row(point={"a.b": "1"})], "frames": []}, [("step a.b=1", "")]),
        ({"rows": [row(step=None)], "frames": []}, []),
        (
            {"rows": [row(threads=[{"threads": n, "step": STEP} for n in (1, 4)])], "frames": []},
            [("step", ""), ("threads 4", "")],
        ),
        (
            {"rows": [], "frames": [frame(), frame(renderer="filament")]},
            [("depth 64x48 high", "a GPU"), ("depth 64x48 high filament", "a GPU")],
        ),
    ],
)
def test_a_figure_is_named_by_what_it_measures_its_point_and_its_device(
    document: dict[str, Any], expected: list[tuple[str, str]]
) -> None:
    assert [figure for figure, _ in figures(document)] == expected


def test_samples_are_divided_by_those_of_the_workload_in_the_same_turn() -> None:
    document = {"rows": [row(reference_workload=WORKLOAD)], "frames": [frame()]}
    (_, step), (_, drawn) = figures(document)
    assert step.workload is not None
    assert step.quotients(step.workload) == [2.0, 2.0, 6.0]
    assert (step.median, drawn.median, drawn.workload) == (4.0, 4.0, None)


@pytest.mark.parametrize("workload", [{"samples": [1.0]}, {"samples": [1.0, 0.0, 1.0]}, {"samples": []}])
def test_a_workload_without_a_positive_sample_for_each_turn_is_refused(workload: dict[str, list[float]]) -> None:
    with pytest.raises(ValueError, match="samples"):
        FigureSamples.read(STEP, workload)
