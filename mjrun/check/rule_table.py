"""All rules by code, and what they find in a model."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from mjrun.check.context import LintContext
from mjrun.check.finding import Finding, Rule, Sighting
from mjrun.check.rules import (
    asset_files,
    blind_cameras,
    compile_errors,
    contacts,
    keyframes,
    keywords,
    limits,
    masses,
    mjcf_schema,
    unknown_names,
    unnamed,
)
from mjrun.check.xml_source import Source, read
from mjrun.errors import BrokenModelError, ModelError, clean

NOT_FOUND, CRASHED, TIMED_OUT, MEMORY, FAILED = "MJ001", "MJ002", "MJ003", "MJ004", "MJ005"
WARNED, UNSTABLE, GAINING, WARNED_STEPPING, GAVE_UP, KNOWN_FAULT = "MJ115", "MJ701", "MJ702", "MJ703", "MJ704", "MJ705"
MOST = 20  # findings of one code in one model

RULES: dict[str, Rule] = {
    # the file and its process
    NOT_FOUND: Rule("error", "no such model file"),
    CRASHED: Rule("error", "MuJoCo crashes"),
    TIMED_OUT: Rule("error", "longer than --timeout"),
    MEMORY: Rule("error", "more memory than --memory"),
    FAILED: Rule("error", "mjrun fails to look at it"),
    # what MuJoCo refuses, or reads and ignores
    compile_errors.REFUSED: Rule("error", "MuJoCo refuses the model"),
    compile_errors.SYNTAX: Rule("error", "not well-formed XML"),
    mjcf_schema.UNKNOWN: Rule("error", "unknown element"),
    mjcf_schema.MISPLACED: Rule("error", "element in the wrong place"),
    mjcf_schema.ATTRIBUTE: Rule("error", "unknown attribute"),
    mjcf_schema.REMOVED: Rule("error", "removed from MuJoCo"),
    mjcf_schema.VALUE: Rule("error", "value outside an attribute"),
    asset_files.MISSING: Rule("error", "missing file"),
    compile_errors.TWIN: Rule("error", "duplicate name"),
    unknown_names.NAME: Rule("error", "reference to nothing"),
    keywords.KEYWORD: Rule("error", "bad value of an attribute"),
    mjcf_schema.TWICE: Rule("error", "element given twice"),
    compile_errors.LACKING: Rule("error", "missing attribute"),
    asset_files.CYCLE: Rule("error", "model that attaches itself"),
    compile_errors.TIMESTEP: Rule("error", "timestep that is not positive"),
    WARNED: Rule("warning", "MuJoCo warns while loading"),
    # names, masses
    "MJ201": Rule("note", "object without a name", unnamed.unnamed),
    compile_errors.MASSLESS: Rule("error", "moving body without mass"),
    "MJ203": Rule("note", "geom without mass", masses.weightless),
    "MJ204": Rule("warning", "extreme principal inertias", masses.flat),
    "MJ205": Rule("warning", "extreme inertias in one tree", masses.steep),
    # limits
    "MJ301": Rule("note", "actuator without limits", limits.unbounded),
    "MJ302": Rule("warning", "reversed range", limits.ignored),
    compile_errors.RANGELESS: Rule("error", "limit without range"),
    "MJ304": Rule("warning", "joint or tendon starts beyond its range", limits.outside),
    "MJ305": Rule("warning", "angle in another unit than meant", limits.other_unit),
    # keyframes
    "MJ401": Rule("error", "keyframe not finite", keyframes.infinite),
    "MJ402": Rule("warning", "keyframe beyond a joint range", keyframes.beyond_joints),
    "MJ403": Rule("warning", "keyframe beyond a control range", keyframes.beyond_controls),
    "MJ404": Rule("warning", "keyframe with a bad quaternion", keyframes.long_quaternions),
    compile_errors.KEY: Rule("error", "keyframe of the wrong size", keyframes.short),
    # contacts and other constraints
    "MJ501": Rule("warning", "initial penetration", contacts.penetrations),
    "MJ502": Rule("warning", "violent initial forces", contacts.forces),
    "MJ503": Rule("warning", "timestep too large for a constraint", contacts.stiff_springs),
    # cameras
    "MJ601": Rule("warning", "camera that sees nothing", blind_cameras.blind),
    # motion
    UNSTABLE: Rule("error", "unstable simulation"),
    GAINING: Rule("warning", "passive model gains energy"),
    WARNED_STEPPING: Rule("warning", "MuJoCo warns while stepping"),
    GAVE_UP: Rule("error", "MuJoCo gives up while stepping"),
    KNOWN_FAULT: Rule("note", "known fault of the installed MuJoCo"),
}


def refusals(error: ModelError, source: Source) -> list[Finding]:
    """Why a model does not load."""
    if isinstance(error, BrokenModelError):
        return _by_code(compile_errors.explain(error, source), source.path)
    first, _, rest = str(error).partition("\n")
    return [finding(NOT_FOUND, Sighting(first.removeprefix(f"{clean(str(source.path))}: "), rest), source.path)]


def dangers(source: Source) -> list[Finding]:
    """What ends or stops MuJoCo's process when the model is loaded."""
    return _by_code(asset_files.dangers(source), source.path)


def ignored(source: Source) -> list[Finding]:
    """What MuJoCo reads over in a model that loads."""
    found = ((code, sighting._replace(severity="warning")) for code, sighting in mjcf_schema.violations(source))
    return _by_code(found, source.path)


def seen(code: str, subject: LintContext) -> list[Finding]:
    """What the rule `code` finds in a model that loads; nothing if it is not for such."""
    find = RULES[code].find
    return capped([finding(code, sighting, subject.path) for sighting in find(subject)]) if find else []


def inspect(path: Path, wanted: Collection[str] = RULES.keys()) -> list[Finding]:
    """All findings in the model `path` that need no step, in this process: a bad file may end it."""
    source = read(path)
    try:
        subject = LintContext.load(path, source)
    except ModelError as error:
        return [*dangers(source), *refusals(error, source)]
    return [*ignored(source), *(found for code in RULES if code in wanted for found in seen(code, subject))]


def _by_code(found: Iterable[tuple[str, Sighting]], path: Path) -> list[Finding]:
    """Findings in the order in which they were found, but those of one code together capped."""
    by_code: dict[str, list[Finding]] = {}
    for code, sighting in found:
        by_code.setdefault(code, []).append(finding(code, sighting, path))
    told = [finding for findings in by_code.values() for finding in capped(findings)]
    return sorted(told, key=lambda finding: (finding.file != str(path), finding.file, finding.line or 0))


def finding(code: str, sighting: Sighting, path: Path) -> Finding:
    """What the rule `code` has seen in the model `path`."""
    return sighting.finding(code, RULES[code].severity, path)


def capped(findings: Sequence[Finding]) -> list[Finding]:
    """At most `MOST` of `findings`, all of one code: repetitions are told once, and the last counts the rest."""
    merged: dict[tuple[str, str, int | None, str], list[Finding]] = {}
    for found in findings:
        alone = "" if found.line else found.object  # what <replicate> makes shares its line
        merged.setdefault((found.message, found.file, found.line, alone), []).append(found)
    told = [_repeated(group) for group in merged.values()]
    if len(told) <= MOST:
        return told
    more = f"… and {len(told) - MOST + 1} more like it"
    return [*told[: MOST - 1], replace(told[MOST - 1], message=more, line=None, object="")]


def _repeated(group: Sequence[Finding]) -> Finding:
    """One finding for all of `group`, which say the same of the same line."""
    more = f" (and {len(group) - 1} more like it)" if len(group) > 1 else ""
    return replace(group[0], message=f"{group[0].message}{more}")
