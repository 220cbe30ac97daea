"""The page about a study: its parameters, metrics, requirements and failures, its figure, and how it was made."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.errors import clean
from mjrun.experiment.design import Design
from mjrun.experiment.results_page_parts import (
    interval,
    origin,
    parameters_table,
    shown_files,
    study_figures,
)
from mjrun.model.table_column import with_unit
from mjrun.options.report import PageOptions
from mjrun.options.sweep import MANIFEST
from mjrun.plotting.html_page import MAKER, VIDEOS, Page, PageFactTable, number, write_page
from mjrun.study.results import SEED, status_counts

if TYPE_CHECKING:
    from mjrun.study.study import StudyResult

QUANTILES = ("Min", "5 %", "25 %", "Median", "75 %", "95 %", "Max")
FACTS = ("command", "model", "mjrun", "mujoco", "numpy", "engine", "wall")
ENGINES = {"c": "MuJoCo", "warp": "MuJoCo Warp, in single precision"}


def write_study_page(
    options: PageOptions,
    result: "StudyResult",
    points: Design,
    units: Mapping[str, str],
    facts: Mapping[str, object],
    model: str,
) -> None:
    """Writes the page of a finished study.

    Args:
      units: units of parameters, by name.
      facts: the command, the versions and the hash of the model.
      model: the model as specified.

    Raises:
      FileError: it cannot be written.
    """
    assert options.html is not None
    figures, notes = study_figures(result.path)
    statuses = status_counts(result.statuses)
    failed = result.points - result.statuses.get("ok", 0)
    shown = {"model": {"path": model, "sha256": facts["model"]}, "engine": ENGINES[str(facts["engine"])]}
    page = Page(
        title=f"{clean(Path(result.path).name)}: study of {clean(Path(model).name)}",
        maker=MAKER,
        verdict=(not failed, f"{result.points:,} points: {statuses}"),
        verdicts=[(result.path, verdict) for verdict in result.assertions],
        facts=[
            *parameters_table(points, units),
            *_metrics(result),
            *_repeats(result),
            *_sensitivities(result),
            *_failures(result),
        ],
        figures=figures,
        files=shown_files([path for path in result.kept.files if Path(path).suffix in VIDEOS], options),
        manifests=[origin(f"{result.path}/{MANIFEST}", {**facts, **shown}, FACTS)],
        notes=notes,
    )
    write_page(options.html, page)


def _metrics(result: "StudyResult") -> list[PageFactTable]:
    rows = [
        (
            clean(with_unit(name, each.unit)),
            f"{each.count:,}",
            *map(number, each.quantiles),
            number(each.mean),
            number(each.std),
        )
        for name, each in result.metrics.items()
    ]
    heads = ("Metric", "Points", *QUANTILES, "Mean", "Std")
    return [PageFactTable("Metrics", "Metrics over all points", heads, rows, range(1, len(heads)))] if rows else []


def _repeats(result: "StudyResult") -> list[PageFactTable]:
    if not result.repeats:
        return []
    names, level = [name for name in result.names if name != SEED], f"{100 * result.confidence:g} % interval"
    rows = [
        (
            *(group.values.get(name, "") for name in names),
            f"{group.points:,}",
            *(text for each in group.metrics.values() for text in (number(each.mean), interval(each.interval))),
        )
        for group in result.repeats
    ]
    means = [head for name, each in result.metrics.items() for head in (clean(with_unit(name, each.unit)), level)]
    heads = (*names, "Points", *means)
    caption = "Means over points that differ in their seed only"
    return [PageFactTable("Repeats", caption, heads, rows, range(len(names), len(heads)))]


def _sensitivities(result: "StudyResult") -> list[PageFactTable]:
    if not result.sensitivities:
        return []
    level, names = f"{100 * result.confidence:g} % interval", list(result.sensitivities[0].indices)
    rows = [
        (
            each.metric,
            each.parameter,
            *(text for index in each.indices.values() for text in (number(index.value), interval(index.interval))),
        )
        for each in result.sensitivities
    ]
    heads = ("Metric", "Parameter", *(head for name in names for head in (name, level)))
    caption = f"Sensitivity of metrics to parameters, from {result.sensitivities[0].samples:,} samples"
    return [PageFactTable("Sensitivity", caption, heads, rows, range(2, len(heads)))]


def _failures(result: "StudyResult") -> list[PageFactTable]:
    rows = [
        (
            each.status,
            f"{each.count:,}",
            clean(each.message),
            f"{each.point}: {', '.join(f'{name}={value}' for name, value in each.values.items())}",
        )
        for each in result.failures
    ]
    heads = ("Status", "Points", "Reason", "The first of them")
    return [PageFactTable("Failures", "Points that failed, by reason", heads, rows, (1,))] if rows else []
