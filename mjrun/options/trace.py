"""Options of traces, and of what else measures again and again."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.diff import ToleranceOptions
from mjrun.options.kinds import ExactNumber, File, Flag, Integer, Optional, Several, Text
from mjrun.options.option import Exclusion, FrontEnd, Options, option, options, required
from mjrun.options.output import TABLES, OutputOptions

PROBES = ("qpos", "qvel", "ctrl", "act", "energy", "contact", "sensor")  # measured where nothing is said


@options
class SamplingOptions(OutputOptions):
    """How often something is measured, and how it is written."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (Exclusion(("every", "rate"), "both say how often"),)

    every: int = option(converter=Integer(1), default=1, help="A row every N steps.")
    rate: Fraction | None = option(
        converter=Optional(ExactNumber("HZ")),
        default=None,
        help="Rows per simulated second [Hz], instead of every N steps; at most one for each step.",
    )
    format: str | None = option(
        converter=Optional(Text("NAME")), default=None, usual="the output's suffix", help="The format."
    )


@options
class GoldenOptions(ToleranceOptions):
    """The comparison of a trace with a golden table."""

    section: ClassVar[str] = "Golden table"

    golden: str | None = option(
        converter=Optional(File()),
        default=None,
        help="A table of an earlier run that this one must agree with, within the tolerances: exit code 1 if not.",
    )
    update: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Make the golden table, or replace it and tell what changed.",
    )


@options
class TraceOptions(SamplingOptions, GoldenOptions):
    """A trace: a table of measured values."""

    section: ClassVar[str] = "Trace"

    output: str = option(
        converter=File(written=True),
        default="-",
        kw_only=False,
        short="-o",
        help=f"{TABLES}, or - for standard output.",
    )
    probe: tuple[str, ...] = option(
        converter=Several(Text("NAME"), commas=True, expected="the name of something to measure"),
        default=PROBES,
        usual=",".join(PROBES),
        help="What to measure: qpos, qvel, qacc, ctrl, act, energy, sensor, contact, xpos, speed, momentum, … or any "
        "field of MjData; of some objects, qpos[left_*], xpos[hand]; or a column, xpos/hand/z.",
    )
    assert_: tuple[str, ...] = option(
        converter=Several(Text("EXPR")),
        default=(),
        help="Fail, with exit code 1, unless this holds: max(abs(energy/drift)) < 1e-3.",
    )
    keep_partial: bool = option(converter=Flag(), default=False, help="Keep the rows before an instability.")
    contacts: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help="A second table, a row for each contact of each instant: which geoms, position and depth [m], "
        "force [N] and torque [N m].",
    )


@options
class TraceCommandLineOptions(Options):
    """What the command can do besides."""

    section: ClassVar[str] = "Trace"

    csv: bool = option(converter=Flag(), default=False, places=FrontEnd.COMMAND, help="Short for --format csv.")
    list_: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="List every column that the model offers, or those of --probe, and stop; nothing is written.",
    )
    verify: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="Step the physics of --replay again, compare every recorded state bit for bit, and stop; the exit code is "
        "1 if one differs, and nothing is written.",
    )


@options
class RecordingOptions(OutputOptions):
    """A recording: the states of all steps, for replay."""

    section: ClassVar[str] = "Recording"

    output: str = required(converter=File(written=True), kw_only=False, help="An .npz file.")
    keep_partial: bool = option(converter=Flag(), default=False, help="Keep the states before an instability.")
