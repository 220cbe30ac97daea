"""Options of the command `eval`: episodes, their metrics and pass criteria."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import ClassVar

from mjrun.options.kinds import FlagKind, Kind, OneOrMoreKind, PathKind, TextKind, optional
from mjrun.options.model import ModelOptions
from mjrun.options.number_kinds import IntegerKind, Numbers, share_of
from mjrun.options.option import FrontEnd, OptionRequirement, Options, option, options, required
from mjrun.options.policy import NormalizationKind, PolicyKind, PolicyOptions
from mjrun.options.report import ExperimentTrackerOptions, PageOptions
from mjrun.options.schema_validation import NUMBER, InvalidValueError, Schema
from mjrun.options.setting_kinds import NamedNumbersKind, SettingsKind
from mjrun.options.simulation import DisturbanceOptions
from mjrun.options.sweep import ConfidenceOptions, VariationOptions
from mjrun.options.video import VIDEO_CLAUSES, PointOrEpisodeVideoOptions

# Extras of evaluations: the library that each installs, and what needs it.
EXTRAS = {"eval": (("scipy", "pyarrow"), "mjrun eval")}
MANIFEST = "evaluation.json"  # of the folder of an evaluation
NO_THRESHOLDS: dict[str, Numbers] = {}
FAILURES = "failures"
WORST = "worst:"


class LowestValuesKind(NamedNumbersKind):
    """Lowest accepted values by name: `success=90%`, `return=200`."""

    metavar = "NAME=VALUE"
    expected = "a name and a number, as in success=90% or return=200"

    @property
    def form(self) -> Schema:
        return {"type": "object", "additionalProperties": NUMBER}

    def __call__(self, value: Mapping[str, float | Sequence[float]]) -> Mapping[str, Numbers]:
        thresholds = super().__call__(value)
        if any(len(numbers) != 1 for numbers in thresholds.values()):
            raise InvalidValueError(self.expected)
        return thresholds

    def parse(self, text: str) -> tuple[str, Numbers]:
        name, _, written = text.rpartition("=")
        try:
            number = share_of(written[:-1]) if written.endswith("%") else float(written)
        except ValueError:
            number = math.nan
        if not name or not math.isfinite(number):
            raise InvalidValueError(self.expected)
        return name, (number,)


class VideoCountKind(Kind[int | str, int | str]):
    """A number of episodes, `worst:N`, or `failures`."""

    metavar = f"N|worst:N|{FAILURES}"
    accepted = f"a number of episodes, {WORST}3 for the three worst, or {FAILURES}"
    words = rf"{WORST}[1-9][0-9]{{0,8}}|{FAILURES}"

    @property
    def form(self) -> Schema:
        number = {"type": "integer", "minimum": 0}
        return {"anyOf": [number, {"type": "string", "pattern": f"^({self.words})$"}], "forms": self.accepted}

    def __call__(self, value: int | str) -> int | str:
        is_count = isinstance(value, int) and not isinstance(value, bool) and value >= 0
        if not is_count and not re.fullmatch(self.words, str(value)):
            raise InvalidValueError(self.accepted)
        return value

    def parse(self, text: str) -> int | str:
        return self(int(text) if text.isascii() and text.isdigit() and len(text) < 10 else text)


@options
class EpisodeVideoOptions(PointOrEpisodeVideoOptions):
    """Videos of selected episodes."""

    section: ClassVar[str] = "Videos"
    requirements: ClassVar[tuple[OptionRequirement, ...]] = tuple(
        OptionRequirement(name, "videos", clause, value="N", test=bool) for name, clause in VIDEO_CLAUSES.items()
    )

    videos: int | str = option(
        converter=VideoCountKind(),
        default=0,
        help="Number of episodes to record as videos, evenly spaced by return: 3 gives the worst, median and best; "
        "worst:3, those with the three lowest returns; failures, all episodes that end in a failure.",
    )


@options
class EvaluationOptions(
    EpisodeVideoOptions,
    PageOptions,
    ExperimentTrackerOptions,
    VariationOptions,
    DisturbanceOptions,
    ConfidenceOptions,
    PolicyOptions,
    ModelOptions,
):
    """An evaluation.

    Args:
      task: the task whose episodes are run.
    """

    section: ClassVar[str] = "Evaluation"
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        OptionRequirement("compare_normalize", "compare", "whose observations it normalizes"),
    )

    task: object = field(kw_only=False)
    output: str = required(
        converter=PathKind("DIR", written=True),
        kw_only=False,
        short="-o",
        usual="TASK_eval",
        help="Folder for the results; running again with the same folder continues an interrupted evaluation.",
    )
    episodes: int = option(
        converter=IntegerKind(1), default=100, help="Number of episodes for each policy and each point of a study."
    )
    seed: int = option(
        converter=IntegerKind(), default=0, help="Seed of the first episode; each later episode uses the next seed."
    )
    compare: object | None = option(
        converter=optional(PolicyKind()),
        default=None,
        help="Second policy, evaluated on the same episodes; the report gives paired differences with confidence "
        "intervals.",
    )
    compare_normalize: str | None = option(
        converter=optional(NormalizationKind()),
        default=None,
        help="Normalization statistics for the observations of the second policy.",
    )
    metric: tuple[tuple[str, str], ...] = option(
        converter=SettingsKind("NAME=EXPR", "effort=mean(abs(ctrl/motor))"),
        default=(),
        key="metrics",
        help="Additional number per episode, computed from a trace with one row per control period: "
        "effort=mean(abs(ctrl/motor)), 'pace [km/h]=3.6*mean(speed/torso)'.",
    )
    require: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("EXPR")),
        default=(),
        help="Exit with code 1 unless this condition holds for the table of episodes: share(success) > 0.9, "
        "quantile(return, 0.05) > 100.",
    )
    fail_below: Mapping[str, Numbers] = option(
        converter=LowestValuesKind(),
        default=NO_THRESHOLDS,
        help="Exit with code 1 if a value is below its threshold: the success rate, success=90%; the mean return, "
        "return=200; its interquartile mean, return_iqm=200; the mean of a metric; or the lower end of a confidence "
        "interval, success_low=0.8.",
    )


@options
class EvaluationReportOptions(Options):
    """Output of the command itself."""

    section: ClassVar[str] = "Report"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    csv: bool = option(converter=FlagKind(), default=False, help="Print the table of all episodes to stdout.")
    markdown: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print the report as Markdown to stdout, for the summary of a pull request.",
    )
    print_document: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print an evaluation document equivalent to this command and exit.",
    )
