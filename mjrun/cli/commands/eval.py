"""Evaluate a policy on episodes of a task: returns, success rates, videos, comparisons."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import ON_FILES, ModelArgument, ParsedCommandLine, command
from mjrun.cli.console import CommandReport, Console
from mjrun.cli.simulation_command import import_mujoco, refuse_assignments, reported_failures, with_camera_scripts
from mjrun.cli.table_cells import ReportColumn, interval_text, number, short_value, verdict_lines
from mjrun.errors import clean, counted
from mjrun.model.table_column import with_unit
from mjrun.options.evaluation import EvaluationOptions, EvaluationReportOptions
from mjrun.options.every_command import opened_file
from mjrun.options.sweep import ExecutionOptions
from mjrun.suffixes import is_yaml

if TYPE_CHECKING:
    from mjrun.evaluation.evaluation import EpisodeFailureGroup, Evaluation, EvaluationResult
    from mjrun.evaluation.summaries import PairedDifference, PointSummary, PolicyComparison, PolicySummary
    from mjrun.experiment.statistics import Interval, NumberSummary, Proportion

    Located = Callable[[], AbstractContextManager[None]]

SHOWN = 40  # points
ARGUMENTS = (
    ModelArgument("task", metavar="TASK|EVALUATION.yaml", type=click.Path(readable=False)),
    click.Argument(["assignments"], metavar="[KEY=VALUE]...", nargs=-1),
)


@command(
    EvaluationOptions,
    ExecutionOptions,
    EvaluationReportOptions,
    *ON_FILES,
    arguments=ARGUMENTS,
    without=["repeats"],
    python="Evaluation",
    reports={"eval": "mjrun.evaluation.evaluation:EvaluationResult"},
)
def eval(console: Console, command_line: ParsedCommandLine) -> None:  # noqa: A001 - the command's name
    """Evaluate a policy on seeded episodes of TASK: returns, success rates, videos, comparisons.

    \b
    mjrun eval task.yaml --policy drive.onnx --episodes 200 -o results
    mjrun eval task.yaml --policy walk.onnx --videos 3 --metric 'effort=mean(abs(ctrl/hip))'
    mjrun eval task.yaml --policy new.onnx --compare old.onnx --fail-below success=90%
    mjrun eval task.yaml --policy walk.onnx --vary 'geom/floor.friction[0]=0.2,0.6,1'
    mjrun eval gym:Walker2d-v5 --policy random --episodes 20
    mjrun eval evaluation.yaml --policy new.onnx episodes=20

    TASK is a task document, an included task such as scene:car_drive, or a Gymnasium environment. KEY=VALUE
    changes a value of the document. Episodes use consecutive seeds, from --seed on; mjrun video TASK --policy P
    --seed S shows the episode with seed S. The same seeds give identical tables. Running again with the same folder
    continues an interrupted evaluation. Exits with 1 if a requirement is not met, and with 8 if episodes failed:
    each failure costs its own episode.

    EVALUATION.yaml is an evaluation document; KEY=VALUE changes a value in it, and options override it.
    """
    import_mujoco()
    options = command_line.make(EvaluationReportOptions)
    form = command_line.form("csv", "markdown")
    evaluation, changes, located = _evaluation(console, command_line)
    command_line.require(opened_file("videos"), evaluation)
    console.page = evaluation.html
    with located():
        if options.print_document:
            from mjrun.document.evaluation import evaluation_text

            console.result(evaluation_text(evaluation, changes, console.command).rstrip("\n"))
        else:
            with reported_failures(console, _report, form=form):
                result = evaluation.run(console)
            console.answer(_report([result]), form)


def _evaluation(console: Console, command_line: ParsedCommandLine) -> "tuple[Evaluation, Sequence[str], Located]":
    """Returns the evaluation of a command line or of its document, the changes to the task, and the context that
    locates its errors.
    """
    from mjrun.document.evaluation import evaluated_task, read_evaluation
    from mjrun.document.reader import KINDS, kind_of_file
    from mjrun.evaluation.evaluation import Evaluation
    from mjrun.model.sources import is_task_name

    path, assignments = command_line.argument("task"), command_line.arguments("assignments")
    command_line = with_camera_scripts(command_line)
    if is_yaml(path) and kind_of_file(path) == KINDS["Evaluation"]:
        values = command_line.explicit(EvaluationOptions, ExecutionOptions)
        request = read_evaluation(path, assignments, values=values, command=console.command)
        return request.made, request.changes, request.located
    if not is_task_name(path):
        refuse_assignments(path, assignments)
    task, rewritten = evaluated_task(path, assignments)
    command_line = command_line.with_defaults(output=f"{task.stem}_eval")
    made = command_line.make(Evaluation, task=task, rewritten=rewritten, command=console.command)
    return made, assignments, nullcontext


def _report(results: "Sequence[EvaluationResult]") -> CommandReport:
    from mjrun.evaluation.summaries import FILES

    result = results[0]
    table = Path(result.path, FILES[1])
    forms = {
        "csv": lambda: table.read_text("utf-8").rstrip("\n"),
        "markdown": lambda: evaluation_markdown(result),
    }
    return CommandReport("eval", result, summary=lambda: evaluation_report(result), forms=forms)


def evaluation_report(result: "EvaluationResult") -> str:
    """Formats returns, success rates, endings, terms of the reward, metrics, videos and the comparison of policies."""
    from mjrun.cli.terminal_layout import TerminalReport

    page, level = TerminalReport(), f"{100 * result.confidence:g} %"
    rows = _number_rows(result)
    page.table("numbers of an episode", _number_columns(rows, level), len(rows))
    if cautions := _cautions(result):
        page.lines("caution", cautions)
    endings = sum(len(each.endings) for each in result.policies)
    page.table("endings", _ending_columns(result.policies, level), endings)
    if successes := _successes(result, level):
        page.lines("success", successes)
    if result.failures:
        page.lines("failed", _failures(result))
    if result.points:
        hint = f"{result.path}/results.csv has all"
        page.table("points", _point_columns(result.points, result.names, level), len(result.points), SHOWN, hint)
    if result.comparison:
        page.lines("comparison", _comparison(result.comparison, level), f"{result.comparison.pairs} pairs")
    if result.videos:
        videos = [(f.rank, f"{clean(f.path)}: return {number(f.returned)}, {clean(f.ending)}") for f in result.videos]
        page.lines("videos", videos)
    if result.assertions:
        page.lines("required", verdict_lines(result.assertions))
    page.note(_last_line(result))
    return page.text()


def evaluation_markdown(result: "EvaluationResult") -> str:
    """Formats the report of an evaluation as Markdown, the requirements and failures first."""
    from mjrun.cli.report_formats import markdown_report

    level, rows = f"{100 * result.confidence:g} %", _number_rows(result)
    lines = [*verdict_lines(result.assertions), *(("failed", f"{name}: {text}") for name, text in _failures(result))]
    lines += [("caution", f"{name}: {text}") for name, text in _cautions(result)]
    lines += [("success", f"{name}: {text}") for name, text in _successes(result, level)]
    lines += [("comparison", f"{name}: {text}") for name, text in _comparison(result.comparison, level)]
    tables = [_number_columns(rows, level), _ending_columns(result.policies, level)]
    tables += [_point_columns(result.points[:SHOWN], result.names, level)] if result.points else []
    return markdown_report(f"mjrun eval: {result.task}", _last_line(result), lines, tables)


def _number_rows(result: "EvaluationResult") -> "list[tuple[str, str, NumberSummary]]":
    """Returns policy, name and summary of each number."""
    numbers = [(each.policy, _numbers(each, result.units)) for each in result.policies]
    return [(policy, name, of[name]) for name in numbers[0][1] for policy, of in numbers]


def _cautions(result: "EvaluationResult") -> list[tuple[str, str]]:
    from mjrun.evaluation.summaries import doubts

    several = len(result.policies) > 1
    names = [*(clean(each.policy) if several else "return" for each in result.policies), "comparison"]
    texts = doubts(result.policies, result.comparison, result.confidence, result.episodes)
    return [(name, text) for name, text in zip(names, texts, strict=False) if text]


def _successes(result: "EvaluationResult", level: str) -> list[tuple[str, str]]:
    several = len(result.policies) > 1
    return [
        (clean(each.policy) if several else "rate", _share(each.success, level))
        for each in result.policies
        if each.success
    ]


def _failures(result: "EvaluationResult") -> list[tuple[str, str]]:
    return [(f"{each.status}, {each.count}", _failure(each, result)) for each in result.failures]


def _numbers(summary: "PolicySummary", units: Mapping[str, str]) -> "dict[str, NumberSummary]":
    rewards = {f"reward/{name}": each for name, each in summary.rewards.items()}
    metrics = {with_unit(name, units.get(name)): each for name, each in summary.metrics.items()}
    return {"return": summary.returns, "length [s]": summary.lengths, **rewards, **metrics}


def _number_columns(rows: "Sequence[tuple[str, str, NumberSummary]]", level: str) -> list[ReportColumn]:
    names, numbers = [clean(name) for _, name, _ in rows], [each for _, _, each in rows]
    columns = [
        ReportColumn("number", names),
        *_policy_column([policy for policy, _, _ in rows]),
        ReportColumn("mean", [number(each.mean) for each in numbers], right=True),
        ReportColumn(level, [interval_text(each.mean_interval) for each in numbers], right=True),
        ReportColumn("iq mean", [number(each.iqm) for each in numbers], right=True),
        ReportColumn(level, [interval_text(each.iqm_interval) for each in numbers], right=True),
        ReportColumn("median", [number(each.median) for each in numbers], right=True),
        ReportColumn(level, [interval_text(each.median_interval) for each in numbers], right=True, extra=True),
        ReportColumn("std", [number(each.std) for each in numbers], right=True, extra=True),
        ReportColumn("min", [number(each.min) for each in numbers], right=True),
        ReportColumn("max", [number(each.max) for each in numbers], right=True),
    ]
    if len({each.count for each in numbers}) > 1:
        columns.append(ReportColumn("episodes", [str(each.count) for each in numbers], right=True))
    return columns


def _ending_columns(policies: "Sequence[PolicySummary]", level: str) -> list[ReportColumn]:
    rows = [(each.policy, ending) for each in policies for ending in each.endings]
    shares = [ending.share for _, ending in rows]
    return [
        ReportColumn("ending", [clean(ending.ending) for _, ending in rows]),
        *_policy_column([policy for policy, _ in rows]),
        ReportColumn("outcome", [ending.outcome for _, ending in rows]),
        ReportColumn("episodes", [str(share.count) for share in shares], right=True),
        ReportColumn("share", [_percent(share.share) for share in shares], right=True),
        ReportColumn(level, [_percents(share.interval) for share in shares], right=True),
    ]


def _policy_column(policies: Sequence[str]) -> list[ReportColumn]:
    """Returns the column of policies, if there are several."""
    return [ReportColumn("policy", [clean(policy) for policy in policies])] if len({*policies}) > 1 else []


def _point_columns(points: "Sequence[PointSummary]", names: Sequence[str], level: str) -> list[ReportColumn]:
    own = [point.policies[0] for point in points]
    columns = [ReportColumn("point", [str(point.point) for point in points], right=True)]
    columns += [
        ReportColumn(clean(name), [clean(short_value(point.values.get(name, ""))) for point in points], right=True)
        for name in names
    ]
    if own[0].success:
        shares = [each.success for each in own]
        columns.append(ReportColumn("success", [_percent(each.share) if each else "" for each in shares], right=True))
        columns.append(ReportColumn(level, [_percents(each.interval) if each else "" for each in shares], right=True))
    columns.append(ReportColumn("return", [number(each.returns.mean) for each in own], right=True))
    columns.append(ReportColumn(level, [interval_text(each.returns.mean_interval) for each in own], right=True))
    columns.append(ReportColumn("length [s]", [number(each.lengths.mean) for each in own], right=True, extra=True))
    if points[0].comparison:
        differences = [point.comparison.returns for point in points if point.comparison]
        columns.append(ReportColumn("difference", [_signed(each.difference) for each in differences], right=True))
        columns.append(ReportColumn("better", [clean(each.better or "") for each in differences]))
    return columns


def _comparison(comparison: "PolicyComparison | None", level: str) -> list[tuple[str, str]]:
    if comparison is None:
        return []
    lines = [("return", _difference(comparison, comparison.returns, level, share=False))]
    if comparison.success:
        lines.append(("success", _difference(comparison, comparison.success, level, share=True)))
    return lines


def _difference(comparison: "PolicyComparison", found: "PairedDifference", level: str, *, share: bool) -> str:
    if found.difference is None:
        return "no pair of episodes that did not fail"
    size = f"{100 * found.difference:+.3g} %" if share else _signed(found.difference)
    interval = _percents(found.interval) if share else interval_text(found.interval)
    method = "Newcombe's paired interval" if share else "paired t interval"
    note = f" ({level} {interval}, {method})" if interval else ""
    if found.iqm is not None:
        iqm_interval = interval_text(found.iqm_interval)
        means = f", of the interquartile means {_signed(found.iqm)}"
        note += means + (f" ({level} {iqm_interval}, paired bootstrap)" if iqm_interval else "")
    verdict = f"{clean(found.better)} is better" if found.better else "no significant difference"
    first, second = clean(comparison.first), clean(comparison.second)
    counts = f"{first} is better in {found.first_wins}, {second} in {found.second_wins}, neither in {found.ties}"
    return f"{verdict}: {first} - {second} is {size}{note}; {counts}"


def _failure(failures: "EpisodeFailureGroup", result: "EvaluationResult") -> str:
    where = [f"seed {failures.seed}"]
    where += [f"point {failures.point}"] if result.points else []
    where += [clean(failures.policy)] if len(result.policies) > 1 else []
    first = "first " if failures.count > 1 else ""
    return f"{clean(failures.message)} ({first}{', '.join(where)})"


def _last_line(result: "EvaluationResult") -> str:
    last = result.seed + result.episodes - 1
    missing = sum(each.count for each in result.failures if each.status == "missing")
    failed = sum(each.count for each in result.failures) - missing
    seeds = f"seeds {result.seed} to {last}" if result.episodes > 1 else f"seed {result.seed}"
    facts = [
        counted(result.episodes, "episode") + (" of each policy" if len(result.policies) > 1 else ""),
        *([f"at {len(result.points)} points"] if result.points else []),
        seeds,
        *([f"{failed:,} failed"] if failed else []),
        *([f"{missing:,} missing"] if missing else []),
        f"{result.steps:,} control periods",
    ]
    return f"{clean(str(Path(result.path)))}: {', '.join(facts)}; {result.wall:.1f} s"


def _share(share: "Proportion", level: str) -> str:
    interval = f"{level} {_percents(share.interval)}, Wilson's interval"
    if share.share is None:
        return "no episode that did not fail"
    return f"{_percent(share.share)}, {share.count} of {share.of} episodes ({interval})"


def _percents(interval: "Interval") -> str:
    if interval.low is None or interval.high is None:
        return ""
    return f"{100 * interval.low:.1f}..{100 * interval.high:.1f} %"


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.3g} %"


def _signed(value: float | None) -> str:
    return "" if value is None else f"{value:+.5g}"
