"""The table of all rules by code, and their findings in a model."""

import importlib
import pkgutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from mjrun.check import rules
from mjrun.check.context import CheckContext
from mjrun.check.finding import Finding, Fix, short_path
from mjrun.check.rule import Rule
from mjrun.check.rules import check_itself, compile_errors, mjcf_schema
from mjrun.errors import BrokenModelError, ModelError, clean, option
from mjrun.model.xml_source import XmlSource

MAX_FINDINGS = 20  # of one code in one model


def _declared() -> Iterator[Rule]:
    """Yields the rules in the modules of `mjrun.check.rules`; rules that several modules import are repeated."""
    for module in pkgutil.iter_modules(rules.__path__):
        values = vars(importlib.import_module(f"{rules.__name__}.{module.name}")).values()
        yield from (value for value in values if isinstance(value, Rule))


RULES = {rule.code: rule for rule in sorted(_declared(), key=lambda rule: rule.code)}


def explain(error: ModelError, source: XmlSource) -> list[Finding]:
    """Returns findings that explain why a model does not load."""
    if isinstance(error, BrokenModelError):
        return _by_place(compile_errors.explain(error, source), source.path)
    message, _, remedy = error.spelled(option).partition("\n")
    reason = message.rpartition(f"{clean(str(source.path))}: ")[-1]  # without the place in the document of a task
    return [check_itself.MISSING_MODEL.in_model(source.path, reason, remedy)]


def ignored_xml(source: XmlSource) -> list[Finding]:
    """Returns findings about the parts of the XML that MuJoCo silently ignores, for a model that loads.

    Those in models that it attaches are left out if comments there suppress them.
    """
    own = mjcf_schema.violations(source, source.root)
    attached = (finding for root in source.attached for finding in mjcf_schema.violations(source, root))
    findings = (*own, *check_itself.IgnoreComments(source.attached_comments).remaining(attached))
    return _by_place((replace(finding, severity="warning") for finding in findings), source.path)


def apply(
    code: str, context: CheckContext, selected: Callable[[Iterable[Finding]], Iterable[Finding]] = iter
) -> list[Finding]:
    """Returns the findings of the rule `code` in a model that loads; none if it does not apply to such a model.

    Args:
      selected: selects the findings to report, before repeated ones are merged.
    """
    return capped(list(selected(RULES[code].findings(context))))


def by_code(findings: Iterable[Finding]) -> dict[str, list[Finding]]:
    """Returns findings by the code of their rule, those of each as `capped` returns them."""
    groups: dict[str, list[Finding]] = {}
    for finding in findings:
        groups.setdefault(finding.code, []).append(finding)
    return {code: capped(group) for code, group in groups.items()}


def _by_place(findings: Iterable[Finding], model: Path) -> list[Finding]:
    """Returns findings by file and line, those in `model` itself first; at most `MAX_FINDINGS` of each code."""
    shown = [finding for group in by_code(findings).values() for finding in group]
    return sorted(shown, key=lambda finding: (finding.file != short_path(model), finding.file, finding.line or 0))


def capped(findings: Sequence[Finding]) -> list[Finding]:
    """Returns at most `MAX_FINDINGS` findings of one code: those that say the same of several objects are merged, and
    the last counts the rest.
    """
    groups: dict[tuple[str, str, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.message, finding.severity, finding.file), []).append(finding)
    merged = [_merged(group) for group in groups.values()]
    if len(merged) <= MAX_FINDINGS:
        return merged
    rest = f"… and {len(merged) - MAX_FINDINGS + 1} more like it"
    hidden = merged[MAX_FINDINGS - 1 :]
    return [*merged[: MAX_FINDINGS - 1], replace(hidden[0], message=rest, line=None, object="", fixes=_fixes(hidden))]


def _merged(group: Sequence[Finding]) -> Finding:
    """Returns one finding for `group`, whose messages are the same, with its other objects."""
    first, *others = group
    return replace(first, others=tuple(finding.object for finding in others), fixes=_fixes(group))


def _fixes(findings: Sequence[Finding]) -> tuple[Fix, ...]:
    return tuple(fix for finding in findings for fix in finding.fixes)
