"""Option values as types: text becomes numbers and names where it is read, so commands get values."""

import math
from fractions import Fraction

import click

from mjrun.timeline import rational


class Size(click.ParamType):
    """`1280x720`."""

    name = "WxH"

    def convert(
        self, value: str | tuple[int, int], param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        width, x, height = value.lower().partition("x")
        if not (x and width.isdecimal() and height.isdecimal() and int(width) and int(height)):
            self.fail(f"{value!r} is not a size; write width x height in pixels, as in 1280x720", param, ctx)
        return int(width), int(height)


class Exact(click.ParamType):
    """A positive number, kept exactly: `0.25`, `30`, `30000/1001`."""

    def __init__(self, unit: str) -> None:
        self.name = unit

    def convert(self, value: str | Fraction, param: click.Parameter | None, ctx: click.Context | None) -> Fraction:
        try:
            number = rational(value)
        except ValueError:
            self.fail(f"{value!r} is not a number", param, ctx)
        if number <= 0:
            self.fail(f"{value} is not a positive number", param, ctx)
        return number


class NotNegative(click.ParamType):
    """A number from 0 on, kept exactly."""

    def __init__(self, unit: str) -> None:
        self.name = unit

    def convert(self, value: str | Fraction, param: click.Parameter | None, ctx: click.Context | None) -> Fraction:
        try:
            number = rational(value)
        except ValueError:
            self.fail(f"{value!r} is not a number", param, ctx)
        if number < 0:
            self.fail(f"{value} is below 0", param, ctx)
        return number


class Range(click.ParamType):
    """Two numbers, the smaller first: `0.5..4`."""

    def __init__(self, form: str) -> None:
        self.name = form

    def convert(
        self, value: str | tuple[float, float], param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        if isinstance(value, tuple):
            return value
        first, _, last = value.partition("..")
        try:
            low, high = float(first), float(last)
        except ValueError:
            low = high = math.nan
        if not -math.inf < low < high < math.inf:
            self.fail(f"{value!r} is not a range; write two numbers, the smaller first, as in 0.5..4", param, ctx)
        return low, high


class Jobs(click.ParamType):
    """A number of processes, or `auto`."""

    name = "N|auto"

    def convert(self, value: str | int, param: click.Parameter | None, ctx: click.Context | None) -> int | str:
        if value == "auto" or isinstance(value, int):
            return value
        if not (value.isascii() and value.isdigit() and 0 < int(value) < 10_000):
            self.fail(f"{value!r} is not a number of processes from 1 on, or auto", param, ctx)
        return int(value)


class Assignment(click.ParamType):
    """`NAME=VALUE` with numbers: `hip=0.3`, `root=0,0,1,1,0,0,0`."""

    name = "NAME=VALUE"

    def convert(
        self, value: str | tuple, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, tuple[float, ...]]:
        if isinstance(value, tuple):
            return value
        name, equals, text = value.rpartition("=")
        try:
            numbers = tuple(float(part) for part in text.split(","))
        except ValueError:
            numbers = (math.nan,)
        if not (equals and name and all(map(math.isfinite, numbers))):
            self.fail(f"{value!r}: write NAME=VALUE, or NAME=VALUE,VALUE,… with finite numbers", param, ctx)
        return name, numbers


class PathValue(click.ParamType):
    """`PATH=VALUE` with any text as the value."""

    name = "PATH=VALUE"

    def convert(self, value: str | tuple, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, str]:
        if isinstance(value, tuple):
            return value
        path, equals, text = value.partition("=")
        if not (equals and path and text):
            self.fail(f"{value!r}: write PATH=VALUE, as in opt.gravity=0,0,10", param, ctx)
        return path, text


class Words(click.ParamType):
    """Words separated by commas: `contactpoint,contactforce`."""

    def __init__(self, name: str) -> None:
        self.name = name

    def convert(self, value: str | tuple, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, ...]:
        return value if isinstance(value, tuple) else tuple(word.strip() for word in value.split(",") if word.strip())


class Groups(click.ParamType):
    """`0,1,2`, `all` or `none`."""

    name = "GROUPS"

    def convert(self, value: str | tuple, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, ...]:
        if isinstance(value, tuple):
            return value
        if value in ("all", "none"):
            return tuple(range(6)) if value == "all" else ()
        words = value.split(",")
        if not all(word in ("0", "1", "2", "3", "4", "5") for word in words):
            self.fail(f"{value!r}: write groups from 0 to 5, as in 0,1,2, or all, or none", param, ctx)
        return tuple(map(int, words))


class Percent(click.ParamType):
    """`10%`, as a share: 0.1."""

    name = "PERCENT"

    def convert(self, value: str | float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        if not isinstance(value, str):
            return value
        try:
            share = float(value.removesuffix("%")) / 100
        except ValueError:
            share = math.nan
        if not (value.endswith("%") and 0 <= share < math.inf):
            self.fail(f"{value!r} is not a percentage; write it as in 10%", param, ctx)
        return share
