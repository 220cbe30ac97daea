"""Options of the command `eval`: episodes of a task under a policy, and what is asked of them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import (
    Camera,
    Choice,
    ExactNumber,
    ExpectedError,
    File,
    Flag,
    Integer,
    Numbers,
    Optional,
    Processes,
    Real,
    Settings,
    Several,
    Size,
    Text,
    Values,
)
from mjrun.options.model import ModelOptions
from mjrun.options.option import Exclusion, FrontEnd, Options, option, options, required
from mjrun.options.policy import NormalizationKind, PolicyKind, PolicyOptions
from mjrun.options.schema import NUMBER, Schema
from mjrun.options.sweep import VariationOptions
from mjrun.options.view import QUALITIES

# Extras of evaluations: the library that each installs, and what needs it.
EXTRAS = {"eval": (("scipy", "pyarrow"), "mjrun eval")}
MANIFEST = "evaluation.json"  # of the folder of an evaluation
NO_THRESHOLDS: dict[str, Numbers] = {}


class Thresholds(Values):
    """The least that is accepted, by the name of what it is asked of: `success=90%`, `return=200`."""

    metavar = "NAME=VALUE"
    expected = "a name and a number, as in success=90% or return=200"

    @property
    def form(self) -> Schema:
        return {"type": "object", "additionalProperties": NUMBER}

    def __call__(self, value: Mapping[str, float | Sequence[float]]) -> Mapping[str, Numbers]:
        thresholds = super().__call__(value)
        if any(len(numbers) != 1 for numbers in thresholds.values()):
            raise ExpectedError(self.expected)
        return thresholds

    def parse(self, text: str) -> tuple[str, Numbers]:
        name, _, written = text.rpartition("=")
        try:
            number = float(written.removesuffix("%")) / (100 if written.endswith("%") else 1)
        except ValueError:
            number = math.nan
        if not name or not math.isfinite(number):
            raise ExpectedError(self.expected)
        return name, (number,)


@options
class FilmOptions(Options):
    """Films of some of the episodes."""

    section: ClassVar[str] = "Films"

    films: int = option(
        converter=Integer(),
        default=0,
        help="Film so many episodes, from the one with the lowest return to the one with the highest: 3 are the worst, "
        "the median and the best.",
    )
    camera: tuple[object, ...] = option(
        converter=Several(Camera()), default="free", help="What the films show: a camera of the model, or a rig."
    )
    size: tuple[int, int] = option(converter=Size(), default=(640, 360), help="Width and height of the films [pixels].")
    quality: str = option(converter=Choice(QUALITIES), default="model", help="How well the films are drawn.")
    fps: Fraction = option(converter=ExactNumber("FPS"), default=30, help="Frames per second of the films [Hz].")
    speed: Fraction = option(
        converter=ExactNumber("FACTOR"), default=1, help="Simulated seconds per second of the films."
    )


@options
class EvaluationOptions(FilmOptions, VariationOptions, PolicyOptions, ModelOptions):
    """An evaluation.

    Args:
      task: what is played.
    """

    section: ClassVar[str] = "Evaluation"
    exclusions: ClassVar[tuple[Exclusion, ...]] = ()

    task: object = field(kw_only=False)
    output: str = required(
        converter=File("DIR", written=True),
        kw_only=False,
        short="-o",
        usual="TASK_eval",
        help="The folder of the results.",
    )
    episodes: int = option(
        converter=Integer(1), default=100, help="How many episodes are played, of each policy and each point."
    )
    seed: int = option(
        converter=Integer(), default=0, help="The seed of the first episode; each episode after it has the next."
    )
    compare: object | None = option(
        converter=Optional(PolicyKind()),
        default=None,
        help="Another policy, which plays the same episodes: who is better, with intervals of the paired differences.",
    )
    compare_normalize: str | None = option(
        converter=Optional(NormalizationKind()),
        default=None,
        help="The statistics that the other policy's observations are normalized with.",
    )
    metric: tuple[tuple[str, str], ...] = option(
        converter=Settings("NAME=EXPR", "effort=mean(abs(ctrl/motor))"),
        default=(),
        key="metrics",
        help="A number of each episode besides its return: effort=mean(abs(ctrl/motor)), over what a trace of it "
        "holds at every control instant.",
    )
    require: tuple[str, ...] = option(
        converter=Several(Text("EXPR")),
        default=(),
        help="Fail, with exit code 1, unless this holds over the table of episodes: share(success) > 0.9, "
        "quantile(return, 0.05) > 100.",
    )
    fail_below: Mapping[str, Numbers] = option(
        converter=Thresholds(),
        default=NO_THRESHOLDS,
        help="Fail, with exit code 1, where this is less: the success rate, success=90%; the mean return, return=200; "
        "the mean of a metric; or the lower end of its interval, success_low=0.8.",
    )
    confidence: float = option(
        converter=Real(above=0, most=0.9999, metavar="SHARE"), default=0.95, help="The confidence of all intervals."
    )


@options
class EvaluationExecutionOptions(Options):
    """How the episodes are played."""

    section: ClassVar[str] = "Execution"

    jobs: int | str = option(
        converter=Processes("N", of="processes"),
        default="auto",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Processes that play episodes.",
    )


@options
class EvaluationCommandOptions(Options):
    """What the command prints."""

    section: ClassVar[str] = "Report"

    csv: bool = option(
        converter=Flag(), default=False, places=FrontEnd.COMMAND, help="The table of all episodes on stdout."
    )
    print_document: bool = option(
        converter=Flag(), default=False, places=FrontEnd.COMMAND, help="Print this command as a document, and stop."
    )
