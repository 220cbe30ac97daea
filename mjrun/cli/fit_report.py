"""What `mjrun fit` says of a fit, for people."""

from typing import TYPE_CHECKING

from mjrun.cli.page_layout import PageLayout
from mjrun.cli.table_cells import Column, number
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.fit.excitation import ExcitationResult
    from mjrun.fit.result import FitResult

CORRELATED = 0.95  # parameters beyond are told
SHOWN = 40


def fit_report(result: "FitResult") -> str:
    """The parameters with their intervals, how well the signals are predicted, and what was written."""
    page = PageLayout()
    if result.partial:
        page.note("partial: the fit was interrupted, and these are the best parameters so far")
    page.table("parameters", _parameters(result), len(result.parameters), SHOWN)
    if result.inertias:
        page.table("inertias", _inertias(result), sum(len(each.quantities) for each in result.inertias), SHOWN)
    page.table("errors", _signals(result), len(result.signals), SHOWN)
    if result.loss != "linear":
        page.note(f"errors and noise by medians, as the loss is {result.loss}: outliers are no part of them")
    if alike := _correlated(result):
        page.lines("correlated", alike)
    if result.changes:
        page.verbatim("changed", result.changes)
    for file in result.files:
        page.note(clean(file))
    segments = f"{result.segments} segment{'' if result.segments == 1 else 's'}"
    page.note(f"reduced χ² {number(result.reduced_chi2)}: residuals over the noise of the log, squared")
    if result.ways:
        page.note(f"fitted: {', then '.join(result.ways)}")
    page.note(f"{result.rows:,} rows in {segments} fitted; {result.rollouts:,} rollouts; {result.wall:.1f} s")
    return page.text()


def excitation_report(result: "ExcitationResult") -> str:
    """The intervals to expect, how far the model moves, and what was written."""
    page = PageLayout()
    parameters, motion = result.parameters, result.motion
    columns = [
        Column("parameter", [clean(each.path) for each in parameters]),
        Column("if it is", [number(each.start) for each in parameters], right=True),
        Column(
            f"expected {100 * result.confidence:g} % interval",
            [f"{number(each.low)} … {number(each.high)}" for each in parameters],
        ),
    ]
    page.table("parameters", columns, len(parameters), SHOWN)
    columns = [
        Column("motion", [clean(each.name) for each in motion]),
        Column("from", [number(each.low) for each in motion], right=True),
        Column("to", [number(each.high) for each in motion], right=True),
        Column("", [each.unit for each in motion]),
        Column("limits", [_range(each.least, each.most) for each in motion]),
    ]
    page.table("motion", columns, len(motion), SHOWN)
    for file in result.files:
        page.note(clean(file))
    page.note(
        f"{result.duration:g} s; the best of {result.candidates} inputs within limits, where they also are at "
        f"{result.corners} corners of the bounds; positions with a noise of {number(result.noise)}; {result.wall:.1f} s"
    )
    return page.text()


def _range(low: float | None, high: float | None) -> str:
    return "" if low is None or high is None else f"{number(low)} … {number(high)}"


def _parameters(result: "FitResult") -> list[Column]:
    parameters = result.parameters
    share = f"{100 * result.confidence:g} % interval"
    return [
        Column("parameter", [clean(each.path) for each in parameters]),
        Column("before", [number(each.start) for each in parameters], right=True),
        Column("fitted", [number(each.value) for each in parameters], right=True),
        Column(share, [f"{number(each.low)} … {number(each.high)}" for each in parameters]),
        Column("", [f"at its {each.bound} bound" if each.bound else "" for each in parameters]),
    ]


def _inertias(result: "FitResult") -> list[Column]:
    rows = [(each.body, quantity) for each in result.inertias for quantity in each.quantities]
    quantities = [quantity for _, quantity in rows]
    return [
        Column("body", [clean(body) for body, _ in rows]),
        Column("", [each.name for each in quantities]),
        Column("before", [number(each.start) for each in quantities], right=True),
        Column("fitted", [number(each.value) for each in quantities], right=True),
        Column("", [each.unit for each in quantities]),
        Column(
            f"{100 * result.confidence:g} % interval",
            [f"{number(each.low)} … {number(each.high)}" if each.low < each.high else "" for each in quantities],
        ),
    ]


def _signals(result: "FitResult") -> list[Column]:
    signals = result.signals
    columns = [
        Column("signal", [clean(each.name) for each in signals]),
        Column("residual", [f"{number(each.noise)} {each.unit}".strip() for each in signals], right=True),
        Column("over noise", [number(each.misfit) for each in signals], right=True),
        Column("before", [_share(each.nominal) for each in signals], right=True),
        Column("fitted", [_share(each.fitted) for each in signals], right=True),
    ]
    if any(each.holdout_fitted is not None for each in signals):
        columns += [
            Column("held out, before", [_share(each.holdout_nominal) for each in signals], right=True),
            Column("fitted", [_share(each.holdout_fitted) for each in signals], right=True),
        ]
    return columns


def _correlated(result: "FitResult") -> list[tuple[str, str]]:
    pairs: list[tuple[str, str]] = []
    for i, one in enumerate(result.parameters):
        for j, other in enumerate(result.parameters[:i]):
            if abs(result.correlation[i][j]) > CORRELATED:
                pairs.append((f"{result.correlation[i][j]:.3f}", f"{clean(other.path)}, {clean(one.path)}"))
    return pairs


def _share(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.3g} %"
