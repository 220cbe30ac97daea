"""`mjrun run`."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjrun.cli import options, summaries, values
from mjrun.cli.console import Console
from mjrun.cli.controller_loader import controller
from mjrun.errors import FileError, clean

if TYPE_CHECKING:
    from mjrun.document.run import Orders


@click.command("run", cls=options.SectionedCommand)
@click.argument("document", type=click.Path())
@click.argument("assignments", metavar="[KEY=VALUE]...", nargs=-1)
@options.run_options
@options.output_options
@click.pass_obj
def command(console: Console, /, as_json: bool, **given: Any) -> None:
    """Make everything that DOCUMENT asks for: films, stills, traces and plots of one simulation, in one pass.

    \b
    mjrun run study.yaml
    mjrun run study.yaml duration=2 films[0].size=640x360 -o out
    mjrun run study.yaml --dry-run
    """
    console.guard_stdout()
    values.import_mujoco()
    from mjrun.job.perform import perform, preview

    orders = _orders(console, given)
    with orders.located():
        if given["dry_run"]:
            _show_plan(console, preview(orders.jobs, console), as_json)
            return
        with _folders(orders.jobs), values.answering(console, as_json, _document):
            results = perform(orders.jobs, console)
    if as_json:
        console.document(_document(results))
    elif console.verbosity >= 0:
        for result in results:
            console.result(summaries.sentence(result))


def _document(results: Sequence[Any]) -> dict[str, Any]:
    return {"results": [{"kind": type(r).__name__.removesuffix("Result"), **asdict(r)} for r in results]}


def _orders(console: Console, given: dict[str, Any]) -> "Orders":
    from mjrun.document.run import Machine, read_run

    machine = Machine(
        controller=controller(given["controller"]) if given["controller"] else None,
        control_dt=given["control_dt"],
        gl=given["gl"] or "auto",
        require_gpu=given["require_gpu"],
        quality=given["quality"],
        jobs=given["jobs"],
        command=console.command,
    )
    return read_run(given["document"], given["assignments"], Path(given["output"] or "."), machine)


@contextmanager
def _folders(jobs: Sequence[Any]) -> Iterator[None]:
    """Makes the folders of all outputs, and takes back those that stay empty."""
    outputs = [Path(path) for job in jobs for _, path in job.files]
    wanted = {folder for path in outputs for folder in path.parents if not folder.exists()}
    try:
        for folder in sorted(wanted):
            try:
                folder.mkdir(exist_ok=True)
            except OSError as error:
                raise FileError(folder, f"cannot be made: {error.strerror or error}") from None
        yield
    finally:
        for folder in sorted(wanted, reverse=True):
            with suppress(OSError):
                folder.rmdir()


def _show_plan(console: Console, plan: Any, as_json: bool) -> None:
    if as_json:
        console.document(asdict(plan))
        return
    console.result(f"simulation: {plan.duration:g} s in {plan.steps} steps of {plan.timestep:g} s")
    for part in plan.outputs:
        count = "an event decides how many" if part.count is None else str(part.count)
        size = f", {part.size[0]}x{part.size[1]}" if len(part.size) == 2 else ""
        console.result(f"{part.kind}: {clean(part.path)}: {count} {part.unit}{size}; {clean(part.about)}")
