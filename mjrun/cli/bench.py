"""`mjrun bench`."""

import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.cli import bench_csv, bench_report
from mjrun.cli.click_command import MODEL, CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import import_mujoco
from mjrun.errors import FileError, UsageError, counted, option
from mjrun.formats.parent_folders import ParentFolders
from mjrun.options.bench import BenchOptions, ReportOptions
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.console import ConsoleOptions

if TYPE_CHECKING:
    pass

SUMMARY = "GITHUB_STEP_SUMMARY"
SLOWER, PARTLY = 1, 8  # exit codes


@command("bench", BenchOptions, ReportOptions, ConfinementOptions, arguments=[MODEL])
def bench(console: Console, command_line: CommandLine) -> None:
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
    report, as_json = command_line.make(ReportOptions), command_line.make(ConsoleOptions).json
    if as_json and (report.csv or report.markdown):
        names = f"{option('json')}, {option('csv')} and {option('markdown')}"
        raise UsageError(f"{names} all write to standard output; give one of them")
    summary = _summary(report.summary)
    console.guard_stdout()
    import_mujoco()
    from mjrun.bench.bench import Bench

    result = command_line.make(Bench, model=command_line.argument("model"), command=console.command).run(console)
    if as_json:
        console.document(asdict(result))
    else:
        format_of = bench_csv.table if report.csv else bench_report.markdown if report.markdown else bench_report.text
        console.result(format_of(result))
    if summary:
        _append(summary, bench_report.markdown(result))
    comparison, failed = result.comparison, sum(bool(row.failure) for row in result.rows)
    if command_line.value("fail_above") is not None and comparison and comparison.verdict in ("slower", "failed"):
        console.fail(SLOWER, "Slower", "slower than the baseline allows, or not measured any more")
    elif failed:
        console.fail(PARTLY, "PartlyDone", f"{failed} of {counted(len(result.rows), 'point')} could not be measured")


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
    parents = ParentFolders(Path(path), Path(os.path.realpath(path)).parent)
    try:
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(text + "\n" if text else "")
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from None
    finally:
        parents.release()
