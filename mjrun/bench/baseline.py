"""Is it slower than it was? The ratio of two benchmarks, with its interval.

An interval knows how samples differ within a benchmark, not what another process did to all of them. That only adds to
a wall time, and the fastest sample escapes it first: what is slower must be so by median and by fastest sample.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjrun.bench.statistics import CONFIDENCE, median, ratio_interval
from mjrun.errors import FileError, UsageError, clean, listing

SCHEMA = "mjrun-bench-1"
FAILED, SLOWER, INCONCLUSIVE, FASTER, FINE = "failed", "slower", "inconclusive", "faster", "not slower"
WORST_FIRST = (FAILED, SLOWER, INCONCLUSIVE, FINE, FASTER)
# What both must have been asked alike, or else they did not do the same.
OPTIONS = ("key", "noise_std", "noise_rate", "settings")
MACHINE = ("system", "cpu", "cores", "available")
ENGINE = ("name", "device", "device_name", "worlds", "nconmax", "njmax")

Figure = tuple[str, str]  # its name, and the device if the processor did not make it


@dataclass(frozen=True)
class Ratio:
    """How one figure changed.

    Attributes:
      name: of the figure: `step`, `threads 2`, `rgb 1280x720 model`, with the point of the grid it belongs to.
      base, now: medians of the wall time [s].
      ratio: of the medians; above 1 is slower.
      low, high: the interval of the ratio at 95 %; None when there are too few samples for one.
      fastest: ratio of the fastest samples.
      verdict: `slower`, if all of the interval and `fastest` are above the limit; `faster`, if all of it is below 1;
        `not slower`, if none of it is above the limit; else `inconclusive`.
    """

    name: str
    base: float
    now: float
    ratio: float
    low: float | None
    high: float | None
    fastest: float
    verdict: str


@dataclass(frozen=True)
class Gone:
    """A figure that the base has, and this benchmark has not.

    Attributes:
      name: of the figure, with the device if the processor did not make it.
      base: median of the wall time [s].
      failure: why it could not be measured, such as an instability; None where it was not to be.
    """

    name: str
    base: float
    failure: str | None


@dataclass(frozen=True)
class Comparison:
    """How a benchmark stands to its base.

    Attributes:
      base: the file.
      limit: the ratio above which a figure is slower.
      verdict: the worst of all figures; `failed` where one of the base could not be measured.
      ratios: of every figure that both have.
      gone: figures that only the base has.
      differences: between model, options and machines, where that was overridden.
    """

    base: str
    limit: float
    verdict: str
    ratios: Sequence[Ratio]
    gone: Sequence[Gone]
    differences: Sequence[str]


def read_base(path: str | Path) -> dict[str, Any]:
    """A benchmark that was saved.

    Raises:
      FileError: it cannot be read, or is none.
    """
    path = Path(path)
    try:
        document = json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise FileError(path, f"is not JSON: {clean(str(error))}") from None
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise FileError(path, "is not a benchmark of this mjrun", f"mjrun bench MODEL --save {path} makes one")
    try:
        list(figures(document))
        differences(document, document)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FileError(path, f"is not a whole benchmark: {type(error).__name__} {clean(str(error))}") from None
    return document


def differences(now: Mapping[str, Any], base: Mapping[str, Any]) -> list[str]:
    """Why `now` and `base` cannot be compared, if they cannot, a sentence each.

    A compiled model is another in every version of MuJoCo; of two versions, the model's file is compared.
    """
    same_mujoco = now["mujoco"] == base["mujoco"]
    fingerprint = "sha256" if same_mujoco else "file_sha256"
    found = []
    if now["model"][fingerprint] != base["model"][fingerprint]:
        found.append("another model" if same_mujoco else "another model file")
    for part, keys in (("engine", ENGINE), ("options", OPTIONS), ("machine", MACHINE)):
        for key in keys:
            there, here = base[part][key], now[part][key]
            if there != here:
                name = "engine" if (part, key) == ("engine", "name") else key
                found.append(f"{name}: {clean(_word(there))} there, {clean(_word(here))} here")
    steps = now["options"]["steps"]
    others = sorted({row["steps"] for row in base["rows"] if row["step"] is not None and row["steps"] != steps})
    if steps is not None and others:
        found.append(f"steps: {', '.join(map(str, others))} there, {steps} here")
    return found


def steps_of(base: Mapping[str, Any], point: Mapping[str, str]) -> int | None:
    """The steps of a rollout at a point of the grid, which a benchmark must take too to be compared."""
    return next((row["steps"] for row in base["rows"] if row["point"] == point and row["step"] is not None), None)


def check_same(now: Mapping[str, Any], base: Mapping[str, Any], path: str, force: bool) -> list[str]:
    """The differences that `force` overrides.

    Raises:
      UsageError: there are some, and no `force`.
    """
    found = differences(now, base)
    if found and not force:
        lines = "\n".join(found)
        raise UsageError(f"{clean(path)} is no base for this benchmark\n{lines}\n--force compares all the same")
    return found


def compare(
    now: Mapping[str, Any], base: Mapping[str, Any], path: str, threshold: float, overridden: Sequence[str] = ()
) -> Comparison:
    """Compares every figure that both documents have, and names those that only the base has.

    Args:
      threshold: by how much a figure may be slower: 0.1 is a tenth.
      overridden: the differences that do not matter, as `check_same` found them.

    Raises:
      UsageError: they have no figure in common, and nothing has failed.
    """
    known, here, limit = dict(figures(base)), dict(figures(now)), 1 + threshold
    ratios = [_ratio(of[0], samples, known[of], limit) for of, samples in here.items() if of in known]
    failures = _failures(now, base)
    gone = [Gone(_shown(of), median(known[of]), failures.get(of)) for of in known if of not in here]
    verdicts = [ratio.verdict for ratio in ratios] + [FAILED for one in gone if one.failure]
    if not verdicts:
        has = listing([*map(_shown, known)])
        raise UsageError(f"{clean(path)} has no figure in common with this benchmark\nit has {has}")
    return Comparison(path, limit, min(verdicts, key=WORST_FIRST.index), ratios, gone, overridden)


def figures(document: Mapping[str, Any]) -> Iterator[tuple[Figure, list[float]]]:
    """All figures that are compared, and their samples [s]."""
    for row in document["rows"]:
        yield from _of_row(row)
    for frame in document["frames"]:
        (width, height), other = frame["size"], frame["renderer"]
        name = f"{frame['view']} {width}x{height} {frame['quality']}" + (f" {other}" if other != "classic" else "")
        yield (name, frame["device"]), _samples(frame["total"])


def _of_row(row: Mapping[str, Any]) -> Iterator[tuple[Figure, list[float]]]:
    """The figures of a point of the grid."""
    point = "".join(f" {path}={value}" for path, value in row["point"].items())
    if row["step"] is not None:
        yield (f"step{point}", ""), _samples(row["step"])
    for threads in row["threads"]:
        if threads["threads"] > 1:
            yield (f"threads {threads['threads']}{point}", ""), _samples(threads["step"])


def _failures(now: Mapping[str, Any], base: Mapping[str, Any]) -> dict[Figure, str]:
    """The figures of the base that could not be measured now, and why."""
    failed = [row for row in now["rows"] if row["failure"] is not None]
    return {
        of: row["failure"]
        for row in failed
        for was in base["rows"]
        if was["point"] == row["point"]
        for of, _ in _of_row(was)
    }


def _samples(stat: Mapping[str, Any]) -> list[float]:
    samples = [float(sample) for sample in stat["samples"]]
    if not samples or min(samples) <= 0:
        raise ValueError("samples must be positive")
    return samples


def _ratio(name: str, samples: Sequence[float], base: Sequence[float], limit: float) -> Ratio:
    interval = ratio_interval(samples, base, CONFIDENCE)
    low, high = (None, None) if interval is None else (interval.low, interval.high)
    before, now, fastest = median(base), median(samples), min(samples) / min(base)
    return Ratio(name, before, now, now / before, low, high, fastest, verdict(low, high, fastest, limit))


def verdict(low: float | None, high: float | None, fastest: float, limit: float) -> str:
    """What a ratio's interval, and that of the fastest samples, say."""
    if low is None or high is None:
        return INCONCLUSIVE
    if low > limit and fastest > limit:
        return SLOWER
    if high < 1:
        return FASTER
    return FINE if high <= limit else INCONCLUSIVE


def _shown(of: Figure) -> str:
    name, device = of
    return f"{name} by {device}" if device else name


def _word(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
