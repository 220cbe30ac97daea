"""Measure the speed of a simulation: steps, phases, threads, rendering, accuracy."""

import os
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from mjrun.cli.bench_report import bench_page, bench_report, markdown
from mjrun.cli.click_command import MODEL, ON_FILES, ParsedCommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import import_mujoco
from mjrun.errors import UsageError, counted, file_errors, option
from mjrun.formats.destinations import ParentFolders
from mjrun.options.bench import SUMMARY, BenchOptions, BenchReportOptions
from mjrun.options.every_command import opened_file

SLOWER, PARTLY = 1, 8  # exit codes


@command(
    BenchOptions,
    BenchReportOptions,
    *ON_FILES,
    arguments=[MODEL],
    python="Bench",
    reports={"bench": "mjrun.bench.results:BenchResult"},
)
def bench(console: Console, command_line: ParsedCommandLine) -> None:
    """Measure the speed of simulating MODEL: its steps and their phases, threads and rendering; and its accuracy.

    Repeats a rollout with the control noise of MuJoCo's testspeed, and reports the median with its confidence
    interval.

    \b
    mjrun bench scene.xml
    mjrun bench scene.xml --scan integrator=euler,rk4 --scan timestep=.001,.002,.004 --accuracy
    mjrun bench scene.xml --render --view rgb --view depth --size 640x480
    mjrun bench scene.xml --engine warp --worlds 4096
    mjrun bench scene.xml --save base.json
    mjrun bench scene.xml --compare base.json --fail-above 10%

    Exits with 8 if points of a --scan could not be measured, for example because their timestep is too long.
    """
    form = command_line.form("csv", "markdown")
    forms = command_line.make(BenchReportOptions)
    command_line.require(opened_file(), forms)
    if forms.html is not None:
        from mjrun.plotting.html_page import check_page_name

        check_page_name(forms.html)
    with _summary(forms.summary) as append:
        import_mujoco()
        from mjrun.bench.bench import Bench

        result = command_line.make(Bench, model=command_line.argument("model"), command=console.command).run(console)
        console.answer(bench_report(result), form)
        append(markdown(result))
        if forms.html is not None:
            from mjrun.plotting.html_page import write_page

            write_page(forms.html, bench_page(result, console.command))
    comparison, failed = result.comparison, sum(bool(row.failure) for row in result.rows)
    if command_line.value("fail_above") is not None and comparison and comparison.verdict in ("slower", "failed"):
        console.fail(SLOWER, "Slower", "slower than the baseline allows, or not measured any more")
    elif failed:
        console.fail(PARTLY, "PartlyDone", f"{failed} of {counted(len(result.rows), 'point')} could not be measured")


@contextmanager
def _summary(file: str | None) -> Generator[Callable[[str], None], None, None]:
    """Appends the report to the summary file, if one is requested, after checking that it can be written.

    A file that did not exist before is removed again if nothing is appended.

    Raises:
      UsageError: no file name is known.
      FileError: it cannot be written.
    """
    path = os.environ.get(SUMMARY.removeprefix("$"), "") if file == SUMMARY else file
    if path is None:
        yield lambda text: None
        return
    if not path:
        raise UsageError(f"{option('summary')}: name a file, since {SUMMARY} does not")

    is_new = not Path(path).exists()
    parents = ParentFolders(Path(path), Path(os.path.realpath(path)).parent)
    try:
        _append(path, "")
        yield lambda text: _append(path, text + "\n")
    finally:
        with suppress(OSError):
            if is_new and not Path(path).stat().st_size:
                Path(path).unlink()
        parents.release()


def _append(path: str, text: str) -> None:
    with file_errors(path, "written"), Path(path).open("a", encoding="utf-8") as file:
        file.write(text)
