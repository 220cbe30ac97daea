"""Options of policies: the policy, the normalization of its observations, and trust in code in its file."""

import re
from os import PathLike, fspath
from typing import ClassVar, cast

from mjrun.options.kinds import FlagKind, Kind, ReadingContext, optional
from mjrun.options.option import FrontEnd, OptionRequirement, Options, option, options
from mjrun.options.schema_validation import (
    TEXT,
    InvalidValueError,
    Schema,
    SchemaViolation,
    SchemaViolationError,
    check,
)

RANDOM, ZERO = BUILT_IN = ("random", "zero")
NONE = "none"
POLICIES = "{policy formats}"  # replaced in help texts by `mjrun.outputs.format_lists`
_CODE = r"(.+\.py|[^\W\d]\w*(\.[^\W\d]\w*)*):[^\W\d]\w*(\.[^\W\d]\w*)*"  # compiled when it is used


class PolicyKind(Kind[object, object]):
    """A policy as text: a file, `random`, `zero` or code. Python also accepts a policy object."""

    metavar = "POLICY"

    @property
    def form(self) -> Schema:
        return TEXT

    def read(self, value: object, reader: ReadingContext) -> object:
        check(value, self.form)
        text = str(value)
        if is_code(text):
            raise SchemaViolationError(
                [SchemaViolation(message="a document cannot contain code; give it on the command line")]
            )
        return reader.input(text) if is_policy_file(text) else text

    def __call__(self, value: object) -> object:
        if value == "":
            raise InvalidValueError("a policy")
        return fspath(cast("PathLike[str]", value)) if isinstance(value, PathLike) else value


class NormalizationKind(Kind[str | PathLike[str], str]):
    """A file with normalization statistics, or `none`."""

    metavar = "FILE|none"

    @property
    def form(self) -> Schema:
        return TEXT

    def read(self, value: object, reader: ReadingContext) -> object:
        check(value, self.form)
        return value if value == NONE else reader.input(str(value))

    def __call__(self, value: str | PathLike[str]) -> str:
        return fspath(value)


@options
class TrustOptions(Options):
    """Permission for files to run code; no document can grant it."""

    section: ClassVar[str] = "Policy"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND | FrontEnd.PYTHON

    trust: bool = option(
        converter=FlagKind(),
        default=False,
        help="Allow policy files that can run code when they are opened: Stable-Baselines3 archives and torch files.",
    )


@options
class PolicyOptions(TrustOptions):
    """A policy that acts in a task."""

    section: ClassVar[str] = "Policy"

    policy: object | None = option(
        converter=optional(PolicyKind()),
        default=None,
        help=f"Policy that acts in the task: {POLICIES}, of which Stable-Baselines3 archives and TorchScript "
        "modules require --trust; Python code, policy.py:act or package.module:Policy; random; or zero.",
    )
    normalize: str | None = option(
        converter=optional(NormalizationKind()),
        default=None,
        help="Statistics that normalize the observations: those of VecNormalize (.pkl), or an .npz with mean, var, "
        "epsilon and clip. Use none for a Stable-Baselines3 policy that was trained without them.",
    )


NORMALIZE_REQUIREMENT = OptionRequirement("normalize", "policy", "whose observations it normalizes")


def is_code(text: str) -> bool:
    """Returns whether a policy is Python code that the user names, `FILE.py:NAME` or `PACKAGE.MODULE:NAME`."""
    return bool(re.fullmatch(_CODE, text))


def is_policy_file(text: str) -> bool:
    """Returns whether a policy is a file or a folder."""
    return text not in BUILT_IN and not is_code(text)
