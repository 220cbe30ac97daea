"""Show what works on this machine, and how to fix the rest."""

from contextlib import suppress
from itertools import groupby
from typing import TYPE_CHECKING

from mjrun.cli.click_command import ParsedCommandLine, command
from mjrun.cli.console import CommandReport, Console, flag
from mjrun.cli.simulation_command import import_mujoco
from mjrun.errors import EncoderError, RendererError, WrongVersionError, clean

if TYPE_CHECKING:
    from mjrun.doctor import DoctorReport

MARKS = {"ok": "✓", "warning": "!", "missing": "✗"}
NOT_NEEDED = "·"


@command(reports={"doctor": "mjrun.doctor:DoctorReport"})
def doctor(console: Console, command_line: ParsedCommandLine) -> None:
    """Show what works on this machine, and how to fix the rest.

    Tests every OpenGL backend, Filament and every encoder. Exits with 2 if a required package has a wrong version, and
    with 5 if no renderer works or the one requested by $MUJOCO_GL and $MUJOCO_EGL_DEVICE_ID does not.
    """
    with suppress(WrongVersionError):  # which the report shows
        import_mujoco()
    from mjrun.doctor import examine

    report = examine(flag)
    console.answer(CommandReport("doctor", report, lambda: _page(report)))
    if any(finding.group == "software" and finding.status == "missing" for finding in report.findings):
        console.fail(WrongVersionError.exit_code, "WrongVersionError", "packages are missing, or of the wrong version")
    elif not report.can_draw:
        console.fail(RendererError.exit_code, "RendererError", "nothing can draw here")
    elif not report.can_encode:
        console.fail(EncoderError.exit_code, "EncoderError", "nothing can encode videos here")


def _page(report: "DoctorReport") -> str:
    width = max(len(finding.name) for finding in report.findings)
    lines: list[str] = []
    for group, findings in groupby(report.findings, key=lambda finding: finding.group):
        lines.append(group)
        for finding in findings:
            mark = NOT_NEEDED if finding.remedy.startswith("not needed") else MARKS[finding.status]
            lines.append(f"  {mark} {finding.name:{width}}  {clean(finding.value)}")
            if finding.remedy:
                lines.append(f"    {'':{width}}  → {finding.remedy}")
    return "\n".join(lines)
