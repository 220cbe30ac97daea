"""`mjrun bench`."""

import os
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from mjrun.cli import bench_csv, bench_options, bench_report, options, values
from mjrun.cli.console import Console
from mjrun.errors import BadValueError, FileError, UsageError, option

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
    """Time the simulation of MODEL: its steps and their phases, threads, drawing; and measure its accuracy.

    Repeats a rollout with the control noise of MuJoCo's own testspeed, and gives the median with its interval.

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
        raise UsageError(
            f"{option('json')}, {option('csv')} and {option('markdown')} all write to standard output; give one of them"
        )
    summary = _summary(given["summary"])
    console.guard_stdout()
    values.import_mujoco()
    result = _job(console, given).run(console)
    if as_json:
        console.document(asdict(result))
    else:
        format_of = (
            bench_csv.table if given["csv"] else bench_report.markdown if given["markdown"] else bench_report.text
        )
        console.result(format_of(result))
    if summary:
        _append(summary, bench_report.markdown(result))
    console.code = _code(result, given["fail_above"] is not None)


def _code(result: "BenchResult", limited: bool) -> int:
    """1 where something is slower than the limit, 8 where points of the grid could not be measured, else 0."""
    if limited and result.comparison and result.comparison.verdict in ("slower", "failed"):
        return SLOWER
    return PARTLY if any(row.failure for row in result.rows) else 0


def _job(console: Console, given: dict[str, Any]) -> "Bench":
    from mjrun.bench.bench import Bench

    if given["fail_above"] is not None and given["compare"] is None:
        raise UsageError(f"{option('fail_above')} has no effect without {option('compare')}, which names the baseline")
    same = ("key", "noise_std", "noise_rate", "steps", "repeats", "accuracy", "horizon", "reference", "whole")
    same += ("engine", "worlds", "device", "nconmax", "njmax", "save", "compare", "force")
    drawings = _drawings(given)
    return Bench(
        values.source(given),
        threads=None if given["threads"] is None else [_count(word) for word in given["threads"]],
        scan=_scan(given["scan"]),
        budget=float(given["budget"]),
        drawings=drawings if given["render"] else (),
        video=drawings[0] if given["whole"] else None,
        fail_above=given["fail_above"] or 0.0,
        command=console.command,
        **{name: given[name] for name in same},
    )


def _scan(assignments: list[tuple[str, str]]) -> dict[str, list[str]]:
    from mjrun.sim.parameter_grid import scan_values

    scan: dict[str, list[str]] = {}
    for path, text in assignments:
        if path in scan:
            raise UsageError(f"{option('scan')} {path} is given twice; give all its values at once")
        scan[path] = scan_values(path, text)
    return scan


def _count(word: str) -> int | str:
    if word == "auto":
        return word
    if not (word.isascii() and word.isdigit() and 0 < int(word) < 10_000):
        raise BadValueError(option("threads"), word, "a number of threads from 1 on, or auto")
    return int(word)


def _drawings(given: dict[str, Any]) -> list["Drawing"]:
    """Every combination of size, view, quality and renderer; the first is what a whole video shows."""
    from mjrun.job.view import SIZE, Drawing
    from mjrun.rendering.visual import Visual

    if not (given["render"] or given["whole"]) and (names := _drawing_options(given)):
        raise UsageError(
            f"{', '.join(map(option, names))}: nothing is drawn\nadd {option('render')} to time frames, or "
            f"{option('whole')} to time a video"
        )
    drawings = [
        Drawing(
            camera=given["camera"] or "free",
            size=size,
            view=view,
            visual=Visual(quality=quality),
            renderer=renderer,
            gl=given["gl"] or "auto",
            require_gpu=given["require_gpu"],
        )
        for renderer, size, quality, view in product(
            given["renderers"] or ["classic"],
            given["sizes"] or [SIZE],
            given["qualities"] or ["model"],
            given["views"] or ["rgb"],
        )
    ]
    if len(drawings) > 1 and not given["render"]:
        raise UsageError(
            f"{option('whole')} times one video, not {len(drawings)}; {option('render')} times several views"
        )
    return drawings


def _drawing_options(given: dict[str, Any]) -> list[str]:
    """The options on the command line that say what is drawn, and how."""
    several = {"size": "sizes", "view": "views", "quality": "qualities", "renderer": "renderers"}
    names = [name for name in ("camera", "require_gpu") if given[name]]
    names += [name for name, plural in several.items() if given[plural]]
    # $MUJOCO_GL says how to draw if anything is drawn; the option, that something is.
    source = click.get_current_context().get_parameter_source("gl")
    return [*names, *(["gl"] if source is ParameterSource.COMMANDLINE else [])]


def _summary(file: str | None) -> str | None:
    """The file that the summary is appended to, which can be written."""
    if file is None:
        return None
    path = file or os.environ.get(SUMMARY, "")
    if not path:
        raise UsageError(f"{option('summary')}: name a file, since ${SUMMARY} does not")
    _append(path, "")
    return path


def _append(path: str, text: str) -> None:
    try:
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(text + "\n" if text else "")
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from None
