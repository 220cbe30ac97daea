"""The page about a benchmark: the tables of its report, the verdict of a comparison, and how it was measured."""

from typing import TYPE_CHECKING

from mjrun.cli.bench_report import machine_line, model_line, notes, sections, single_point
from mjrun.plotting.html_page import Page, PageFactTable
from mjrun.plotting.manifest_html import FileManifest
from mjrun.plotting.page_writer import MAKER

if TYPE_CHECKING:
    from mjrun.bench.results import BenchResult

BAD = ("slower", "failed")
INDENT = "\u2003"  # of phases within others: browsers join spaces


def bench_page(result: "BenchResult", command: str) -> Page:
    """Returns the page about a benchmark."""
    facts = [PageFactTable("Step", "Cost of a step", ("", ""), rows)] if (rows := single_point(result)) else []
    for title, (heads, *cells) in sections(result):
        rows = [[cell.replace("  ", INDENT) for cell in row] for row in cells]
        name, caption = title.partition(",")[0], " ".join(title.split())
        facts.append(PageFactTable(name[:1].upper() + name[1:], caption, heads, rows, range(1, len(heads))))
    comparison, machine = result.comparison, result.machine
    origin = {
        "command": command,
        "mujoco": result.mujoco,
        "model": {"path": result.model.path, "sha256": result.model.sha256},
        "processor": machine.cpu,
        "cores": machine.available,
        "system": machine.system,
        "load": machine.load,
    }
    return Page(
        title=model_line(result),
        maker=MAKER,
        verdict=(comparison.verdict not in BAD, comparison.verdict) if comparison else None,
        notes=[machine_line(result), *(f"Note: {text}" for text in notes(result))],
        facts=facts,
        manifests=[FileManifest("This benchmark", origin)],
    )
