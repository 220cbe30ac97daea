"""What `mjrun eval` says of a policy, for people."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.cli.page_layout import PageLayout
from mjrun.cli.table_cells import Column, number
from mjrun.errors import clean, counted

if TYPE_CHECKING:
    from mjrun.evaluation.comparison import Comparison, PairedDifference
    from mjrun.evaluation.result import EvaluationResult, PointSummary
    from mjrun.evaluation.statistics import Interval, NumberSummary, Share
    from mjrun.evaluation.summary import EpisodeSummary

SHOWN = 40  # points


def evaluation_report(result: "EvaluationResult") -> str:
    """Returns, successes, endings, terms of the reward, metrics, films, and who is better."""
    page, level = PageLayout(), f"{100 * result.confidence:g} %"
    numbers = [(each.policy, _numbers(each)) for each in result.policies]
    rows = [(policy, name, of[name]) for name in numbers[0][1] for policy, of in numbers]
    page.table("numbers of an episode", _number_columns(rows, level), len(rows))
    endings = sum(len(each.endings) for each in result.policies)
    page.table("endings", _ending_columns(result.policies, level), endings)
    if successes := [(each.policy, each.success) for each in result.policies if each.success]:
        several = len(successes) > 1
        page.lines("success", [(clean(name) if several else "rate", _share(each, level)) for name, each in successes])
    if result.points:
        hint = f"{result.path}/results.csv has all"
        page.table("points", _point_columns(result.points, result.names, level), len(result.points), SHOWN, hint)
    if result.comparison:
        page.lines("comparison", _comparison(result.comparison, level), f"{result.comparison.pairs} pairs")
    if result.films:
        films = [(f.rank, f"{clean(f.path)}: return {number(f.returned)}, {clean(f.ending)}") for f in result.films]
        page.lines("films", films)
    if result.assertions:
        verdicts = [("holds" if verdict.passed else "FAILS", clean(verdict.message)) for verdict in result.assertions]
        page.lines("required", verdicts)
    page.note(_last_line(result))
    return page.text()


def _numbers(summary: "EpisodeSummary") -> "dict[str, NumberSummary]":
    rewards = {f"reward/{name}": each for name, each in summary.rewards.items()}
    return {"return": summary.returns, "length [s]": summary.lengths, **rewards, **summary.metrics}


def _number_columns(rows: "Sequence[tuple[str, str, NumberSummary]]", level: str) -> list[Column]:
    names, numbers = [clean(name) for _, name, _ in rows], [each for _, _, each in rows]
    columns = [
        Column("number", names),
        *_policy_column([policy for policy, _, _ in rows]),
        Column("mean", [number(each.mean) for each in numbers], right=True),
        Column(level, [_interval(each.mean_interval) for each in numbers], right=True),
        Column("median", [number(each.median) for each in numbers], right=True),
        Column(level, [_interval(each.median_interval) for each in numbers], right=True, extra=True),
        Column("std", [number(each.std) for each in numbers], right=True, extra=True),
        Column("min", [number(each.min) for each in numbers], right=True),
        Column("max", [number(each.max) for each in numbers], right=True),
    ]
    if len({each.count for each in numbers}) > 1:
        columns.append(Column("episodes", [str(each.count) for each in numbers], right=True))
    return columns


def _ending_columns(policies: "Sequence[EpisodeSummary]", level: str) -> list[Column]:
    rows = [(each.policy, ending) for each in policies for ending in each.endings]
    shares = [ending.share for _, ending in rows]
    return [
        Column("ending", [clean(ending.ending) for _, ending in rows]),
        *_policy_column([policy for policy, _ in rows]),
        Column("outcome", [ending.outcome for _, ending in rows]),
        Column("episodes", [str(share.count) for share in shares], right=True),
        Column("share", [_percent(share.share) for share in shares], right=True),
        Column(level, [_percents(share.interval) for share in shares], right=True),
    ]


def _policy_column(policies: Sequence[str]) -> list[Column]:
    """Who played, where there are several."""
    return [Column("policy", [clean(policy) for policy in policies])] if len({*policies}) > 1 else []


def _point_columns(points: "Sequence[PointSummary]", names: Sequence[str], level: str) -> list[Column]:
    own = [point.policies[0] for point in points]
    columns = [Column("point", [str(point.point) for point in points], right=True)]
    columns += [Column(clean(name), [clean(point.values[name]) for point in points], right=True) for name in names]
    if own[0].success:
        shares = [each.success for each in own]
        columns.append(Column("success", [_percent(each.share) if each else "" for each in shares], right=True))
        columns.append(Column(level, [_percents(each.interval) if each else "" for each in shares], right=True))
    columns.append(Column("return", [number(each.returns.mean) for each in own], right=True))
    columns.append(Column(level, [_interval(each.returns.mean_interval) for each in own], right=True))
    columns.append(Column("length [s]", [number(each.lengths.mean) for each in own], right=True, extra=True))
    if points[0].comparison:
        differences = [point.comparison.returns for point in points if point.comparison]
        columns.append(Column("difference", [_signed(each.difference) for each in differences], right=True))
        columns.append(Column("better", [clean(each.better or "") for each in differences]))
    return columns


def _comparison(comparison: "Comparison", level: str) -> list[tuple[str, str]]:
    lines = [("return", _difference(comparison, comparison.returns, level, share=False))]
    if comparison.success:
        lines.append(("success", _difference(comparison, comparison.success, level, share=True)))
    return lines


def _difference(comparison: "Comparison", found: "PairedDifference", level: str, *, share: bool) -> str:
    size = f"{100 * found.difference:+.3g} %" if share else _signed(found.difference)
    interval = _percents(found.interval) if share else _interval(found.interval)
    method = "Newcombe's paired interval" if share else "paired t interval"
    note = f" ({level} {interval}, {method})" if interval else ""
    verdict = f"{clean(found.better)} is better" if found.better else "no difference can be told"
    first, second = clean(comparison.first), clean(comparison.second)
    counts = f"{first} is better in {found.first_wins}, {second} in {found.second_wins}, neither in {found.ties}"
    return f"{verdict}: {first} - {second} is {size}{note}; {counts}"


def _last_line(result: "EvaluationResult") -> str:
    last = result.seed + result.episodes - 1
    seeds = f"seeds {result.seed} to {last}" if result.episodes > 1 else f"seed {result.seed}"
    facts = [
        counted(result.episodes, "episode") + (" of each policy" if len(result.policies) > 1 else ""),
        *([f"at {len(result.points)} points"] if result.points else []),
        seeds,
        f"{result.steps:,} control periods",
    ]
    return f"{clean(str(Path(result.path)))}: {', '.join(facts)}; {result.wall:.1f} s"


def _share(share: "Share", level: str) -> str:
    interval = f"{level} {_percents(share.interval)}, Wilson's interval"
    return f"{_percent(share.share)}, {share.count} of {share.of} episodes ({interval})"


def _interval(interval: "Interval") -> str:
    return "" if interval.low is None else f"{number(interval.low)}..{number(interval.high)}"


def _percents(interval: "Interval") -> str:
    if interval.low is None or interval.high is None:
        return ""
    return f"{100 * interval.low:.1f}..{100 * interval.high:.1f} %"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _signed(value: float) -> str:
    return f"{value:+.5g}"
