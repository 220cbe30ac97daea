"""Conversion of requests to documents."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Protocol, cast, runtime_checkable

from mjrun.document.builder import refusal
from mjrun.document.tree import Mapped, Plain, exact, meaning, number
from mjrun.errors import UsageError, clean, option
from mjrun.model.sources import source_of
from mjrun.options.kinds import AnyKind, PathKind
from mjrun.options.option import Option, Options, document_options, is_always_written
from mjrun.options.policy import PolicyKind, is_code
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.setting_kinds import SettingsKind, setting_text
from mjrun.options.structured_kinds import plain_values
from mjrun.outputs.output import OutputRequest, OutputResult
from mjrun.simulation.simulation import Simulation
from mjrun.task.task import Task


@runtime_checkable
class _HasDocumentForm(Protocol):
    """A value with a form of documents, such as a camera script."""

    def inline(self) -> Options:
        """Returns the options that describe it."""
        ...


def document_text(requests: Sequence[OutputRequest[OutputResult]], command: str = "") -> str:
    """Formats the run document of `requests`, which share one simulation, without default values.

    Options that apply to this machine only, such as the OpenGL backend, are left out. Files are relative to the
    current folder.

    Args:
      command: the command that made the requests, for a comment.

    Raises:
      UsageError: a document cannot contain this: code, a compiled model, an output outside of a folder.
    """
    from mjrun.document.run import OUTPUTS  # slow to import, and other documents need only what follows

    if not requests or any(request.simulation is not requests[0].simulation for request in requests):
        raise UsageError("a run document requires outputs of a single simulation")
    outputs: dict[str, list[Plain]] = {}
    for request in requests:
        key = next(key for key, output in OUTPUTS.items() if isinstance(request, output))
        options = plain_options(request)
        outputs.setdefault(key, []).append(request.output if [*options] == ["output"] else options)
    return text_of({**simulation_document(requests[0].simulation), **outputs}, command)


def text_of(document: Mapped, command: str) -> str:
    """Formats a document, with a comment about the command that made it."""
    from mjrun.document.yaml_text import yaml_text  # PyYAML is slow to import

    comment = f"# {clean(command)}\n" if command else ""
    return comment + yaml_text(_escaped(document))


def simulation_document(simulation: Simulation) -> Mapped:
    if simulation.controller is not None:
        raise UsageError(f"{option('controller')}: a document cannot contain code; give it on the command line")
    source = source_of(simulation.model)
    if not source.text:
        raise UsageError("a document cannot contain a compiled model; give its file")
    own = () if isinstance(source, Task) else source.overrides  # a task's overrides are in its document
    overrides = [*((override.path, override.value) for override in own), *simulation.set]
    settings = {"set": _settings(overrides)} if overrides else {}
    return {"model": source.text, **plain_options(simulation), **settings}


def plain_options(values: Options) -> Mapped:
    """Returns the document keys of all `values` that differ from their defaults."""
    written = [(each, getattr(values, each.attribute)) for each in document_options(type(values))]
    return {
        each.key: plain_value(each.kind, value)
        for each, value in written
        if value is not None and (is_always_written(each) or value != each.default)
        if not _refused(each, value)
    }


def _refused(each: Option, value: object) -> bool:
    """Raises UsageError for code, and for outputs that no document may write."""
    if isinstance(each.kind, PolicyKind) and not (isinstance(value, str) and not is_code(value)):
        raise UsageError(f"{option(each.name)}: a document cannot contain code; give it on the command line")
    if isinstance(each.kind, PathKind) and each.kind.written and (reason := refusal(str(value))):
        raise UsageError(f"{reason}; give a path relative to a folder", path=(each.name,))
    return False


def plain_value(kind: AnyKind, value: object) -> Plain:
    """Returns `value` in its document form."""
    if isinstance(kind, SettingsKind):
        return _settings(cast("Sequence[tuple[str, str]]", value))
    return _written(kind.plain(value))


def _written(value: object) -> Plain:
    """Converts plain values to YAML types, including exact numbers, events and camera scripts."""
    match value:
        case Fraction():
            return exact(value)
        case Options():
            return _written(plain_values(value))
        case _HasDocumentForm():
            return _written(plain_values(value.inline()))
        case bool() | str():
            return value
        case int() | float():
            return number(value)
        case list() | tuple():
            return [_written(part) for part in cast("Sequence[object]", value)]
        case dict():
            return {key: _written(part) for key, part in cast("dict[str, object]", value).items()}
        case _:
            assert value is None
            return value


def _settings(settings: Sequence[tuple[str, str]]) -> Mapped:
    written: Mapped = {}
    for path, text in settings:
        if path in written:
            raise UsageError(f"{clean(path)} is set twice; a document can set it only once")
        written[path] = _setting(text)
    return written


def _setting(text: str) -> Plain:
    """Converts the text of a setting to a number, a list of numbers or a boolean, if that restores the same text."""
    parts: list[Plain] = [meaning(part) for part in text.split(",")]
    value = parts[0] if len(parts) == 1 else parts
    try:
        return value if setting_text(value) == text else text
    except InvalidValueError:
        return text


def _escaped(value: Plain) -> Plain:
    """Escapes `${` in all texts, so that none refers to a variable."""
    match value:
        case str():
            return value.replace("${", "$${")
        case dict():
            return {key: _escaped(inner) for key, inner in value.items()}
        case list():
            return [_escaped(inner) for inner in value]
        case _:
            return value
