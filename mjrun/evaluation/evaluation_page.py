"""The page about an evaluation: returns, endings and terms of the reward, the episodes, videos, and how it was made."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.errors import clean
from mjrun.evaluation.summaries import FILES, LENGTH, RETURN, PairedDifference, PolicySummary, doubts, seed_column
from mjrun.experiment.design import Design
from mjrun.experiment.results_page_parts import (
    interval,
    origin,
    parameters_table,
    shown_files,
    study_figures,
    table_figure,
)
from mjrun.experiment.statistics import Interval, NumberSummary
from mjrun.model.table_column import with_unit
from mjrun.options.evaluation import MANIFEST
from mjrun.options.plot import FigureOptions
from mjrun.options.report import PageOptions
from mjrun.plotting.html_page import MAKER, Page, PageFactTable, PageFigure, number, write_page

if TYPE_CHECKING:
    from mjrun.evaluation.evaluation import EvaluationResult

FACTS = ("command", "mjrun", "mujoco", "task", "episodes", "seed", "confidence", "steps", "wall")


def write_evaluation_page(
    options: PageOptions, result: "EvaluationResult", points: Design, facts: Mapping[str, object]
) -> None:
    """Writes the page of a finished evaluation.

    Raises:
      FileError: it cannot be written.
    """
    assert options.html is not None
    folder = Path(result.path)
    figures, notes = list[PageFigure](), list[str]()
    if points.names:
        figures, notes = study_figures(folder)
    elif len(result.policies) == 1:
        seeds = seed_column(range(result.seed, result.seed + result.episodes))
        x = "episode" if seeds.numbers is None else "seed"
        figures = [table_figure(folder / FILES[0], FigureOptions(x=x, y=(RETURN, LENGTH), columns=1))]
    page = Page(
        title=f"{clean(result.task)}: {' and '.join(clean(each.policy) for each in result.policies)}",
        maker=MAKER,
        verdicts=[(result.path, verdict) for verdict in result.assertions],
        facts=[
            *(_policy(each, result, several=len(result.policies) > 1) for each in result.policies),
            *_comparison(result),
            *parameters_table(points, result.units),
            *_endings(result),
            *_failed(result),
        ],
        figures=figures,
        files=shown_files([video.path for video in result.videos], options),
        manifests=[origin(folder / MANIFEST, facts, FACTS)],
        notes=notes,
    )
    write_page(options.html, page)


def _policy(summary: PolicySummary, result: "EvaluationResult", *, several: bool) -> PageFactTable:
    named: dict[str, NumberSummary] = {"return": summary.returns, "length [s]": summary.lengths}
    named |= {f"reward {name}": each for name, each in summary.rewards.items()}
    named |= {with_unit(name, result.units.get(name)): each for name, each in summary.metrics.items()}
    rows = [
        (
            name,
            f"{each.count:,}",
            number(each.mean),
            interval(each.mean_interval),
            number(each.iqm),
            interval(each.iqm_interval),
            number(each.median),
            number(each.std),
            number(each.min),
            number(each.max),
        )
        for name, each in named.items()
    ]
    if (success := summary.success) is not None:
        shares = _percents(success.share, success.interval)
        rows.insert(0, ("success", f"{summary.episodes:,}", *shares, "", "", "", "", "", ""))
    level = f"{100 * result.confidence:g} % interval"
    heads = ("", "Episodes", "Mean", level, "Interquartile mean", level, "Median", "Std", "Min", "Max")
    title = f"Results of {clean(summary.policy)}" if several else "Results"
    episodes = f"{summary.episodes:,} episodes of {clean(summary.policy)}"
    caption = "; ".join(filter(None, [episodes, *doubts([summary], None, result.confidence, result.episodes)]))
    return PageFactTable(title, caption, heads, rows, range(1, 10))


def _comparison(result: "EvaluationResult") -> list[PageFactTable]:
    compared = result.comparison
    if compared is None:
        return []
    differences: list[tuple[str, PairedDifference]] = [("return", compared.returns)]
    if compared.success is not None:
        differences.append(("success", compared.success))
    rows = [
        (
            name,
            *(
                _percents(each.difference, each.interval)
                if name == "success"
                else (number(each.difference), interval(each.interval))
            ),
            number(each.iqm),
            interval(each.iqm_interval),
            clean(each.better or "undecided"),
            f"{each.first_wins:,} / {each.second_wins:,} / {each.ties:,}",
        )
        for name, each in differences
    ]
    level = f"{100 * result.confidence:g} % interval"
    heads = ("", "Difference", level, "Of interquartile means", level, "Better", "Wins / losses / ties")
    pairs = f"{clean(compared.first)} minus {clean(compared.second)}, over {compared.pairs:,} pairs of episodes"
    caption = "; ".join(filter(None, [pairs, *doubts([], compared, result.confidence, result.episodes)]))
    return [PageFactTable("Comparison", caption, heads, rows, range(1, 5))]


def _endings(result: "EvaluationResult") -> list[PageFactTable]:
    rows = [
        (each.ending, clean(policy.policy), each.outcome, *_percents(each.share.share, each.share.interval))
        for policy in result.policies
        for each in policy.endings
    ]
    heads = ("Ending", "Policy", "Outcome", "Share", f"{100 * result.confidence:g} % interval")
    return [PageFactTable("Endings", "How episodes ended", heads, rows, (3, 4))] if rows else []


def _failed(result: "EvaluationResult") -> list[PageFactTable]:
    rows = [
        (each.status, clean(each.policy), f"{each.count:,}", f"{each.seed}", clean(each.message))
        for each in result.failures
    ]
    heads = ("Status", "Policy", "Episodes", "First seed", "Reason")
    return (
        [PageFactTable("Failures", "Episodes that failed, which no other number includes", heads, rows, (2, 3))]
        if rows
        else []
    )


def _percents(share: float | None, ends: Interval) -> tuple[str, str]:
    """Formats a share, or a difference of shares, and its interval."""
    low, high = ends.low, ends.high
    interval = "" if low is None or high is None else f"{number(100 * low, 3)} … {number(100 * high, 3)} %"
    return "" if share is None else f"{number(100 * share, 3)} %", interval
