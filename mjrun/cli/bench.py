"""`mjrun bench`."""

import os
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjrun.cli import bench_options, bench_report, options, values
from mjrun.cli.console import Console
from mjrun.errors import BadValueError, FileError, UsageError

if TYPE_CHECKING:
    from mjrun.bench.bench import Bench
    from mjrun.bench.results import BenchResult
    from mjrun.job.view import Drawing

SUMMARY = "GITHUB_STEP_SUMMARY"
SLOWER, PARTLY = 1, 8  # exit codes


@click.command("bench", cls=options.SectionedCommand)
@options.model_argument
@bench_options.measurement_options
@bench_options.engine_options
@bench_options.simulation_options
@options.model_options
@bench_options.drawing_options
@bench_options.report_options
@options.output_options
@click.pass_obj
def command(console: Console, /, as_json: bool, **given: Any) -> None:
    """Time the simulation of MODEL: its steps, their phases, threads, drawing; and tell what it is worth.

    Rolls out the stimulus of MuJoCo's own testspeed again and again, and gives the median with its interval.

    \b
    mjrun bench scene.xml
    mjrun bench scene.xml --scan integrator=euler,rk4 --scan timestep=.001,.002,.004 --accuracy
    mjrun bench scene.xml --render --view rgb --view depth --size 640x480
    mjrun bench scene.xml --engine warp --worlds 4096
    mjrun bench scene.xml --save base.json
    mjrun bench scene.xml --compare base.json --fail-above 10%

    Exits with 8 when points of a --scan could not be measured, as with a timestep that is too long.
    """
    if sum((as_json, given["csv"], given["markdown"])) > 1:
        raise UsageError("--json, --csv and --markdown all want standard output; give one of them")
    summary = _summary(given["summary"])
    console.guard_stdout()
    values.import_mujoco()
    result = _job(console, given).run(console)
    if as_json:
        console.document(asdict(result))
    else:
        form = "csv" if given["csv"] else "markdown" if given["markdown"] else "text"
        console.result(bench_report.FORMS[form](result))
    if summary:
        _append(summary, bench_report.markdown(result))
    console.code = _code(result, given["fail_above"] is not None)


def _code(result: "BenchResult", limited: bool) -> int:
    """1 where a comparison with a limit is lost, 8 where points of the grid could not be measured, else 0."""
    if limited and result.comparison and result.comparison.verdict in ("slower", "failed"):
        return SLOWER
    return PARTLY if any(row.failure for row in result.rows) else 0


def _job(console: Console, given: dict[str, Any]) -> "Bench":
    from mjrun.bench.bench import Bench

    if given["fail_above"] is not None and given["compare"] is None:
        raise UsageError("--fail-above is the limit of a comparison; name the base with --compare FILE")
    same = ("key", "noise_std", "noise_rate", "steps", "repeats", "accuracy", "horizon", "reference", "whole")
    same += ("engine", "worlds", "device", "nconmax", "njmax", "save", "compare", "force")
    return Bench(
        values.source(given),
        threads=None if given["threads"] is None else [_count(word) for word in given["threads"]],
        scan=_scan(given["scan"]),
        budget=float(given["budget"]),
        drawings=_drawings(given),
        fail_above=given["fail_above"] or 0.0,
        command=console.command,
        **{name: given[name] for name in same},
    )


def _scan(given: list[tuple[str, str]]) -> dict[str, list[str]]:
    from mjrun.sim.parameter_grid import scan_values

    found: dict[str, list[str]] = {}
    for path, text in given:
        if path in found:
            raise UsageError(f"--scan {path} is given twice; give all its values at once")
        found[path] = scan_values(path, text)
    return found


def _count(word: str) -> int | str:
    if word == "auto":
        return word
    if not (word.isascii() and word.isdigit() and 0 < int(word) < 10_000):
        raise BadValueError("--threads", word, "a number of threads from 1 on, or auto")
    return int(word)


def _drawings(given: dict[str, Any]) -> list["Drawing"]:
    """Every combination of size, view, quality and renderer."""
    from mjrun.job.view import SIZE, Drawing
    from mjrun.rendering.visual import Visual

    several = {name: given[name] for name in ("sizes", "views", "qualities", "renderers")}
    if not given["render"]:
        if any(several.values()):
            raise UsageError("--size, --view, --quality and --renderer say what is drawn; add --render to time it")
        return []
    return [
        Drawing(
            camera=given["camera"],
            size=size,
            view=view,
            visual=Visual(quality=quality),
            renderer=renderer,
            gl=given["gl"] or "auto",
            require_gpu=given["require_gpu"],
        )
        for renderer, size, quality, view in product(
            several["renderers"] or ["classic"],
            several["sizes"] or [SIZE],
            several["qualities"] or ["model"],
            several["views"] or ["rgb"],
        )
    ]


def _summary(given: str | None) -> str | None:
    """The file that the summary is appended to, which can be written."""
    if given is None:
        return None
    path = given or os.environ.get(SUMMARY, "")
    if not path:
        raise UsageError(f"--summary: name a file; there is no ${SUMMARY} to take it from")
    _append(path, "")
    return path


def _append(path: str, text: str) -> None:
    try:
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(text + "\n" if text else "")
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from None
