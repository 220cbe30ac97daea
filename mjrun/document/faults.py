"""Faults of values in a document: the place, the expected value and the actual value."""

from collections.abc import Callable, Iterable, Sequence
from typing import cast

from mjrun.document.tree import (
    Fault,
    InvalidNode,
    ListNode,
    MappingNode,
    Node,
    Path,
    ScalarNode,
    described,
    find,
    key_mark,
    path_text,
    plain,
    shortened,
    written_path,
)
from mjrun.errors import DocumentError, Problem, UsageError, listing, quoted, spelled, suggestion
from mjrun.options.kinds import Several
from mjrun.options.option import Options, document_options
from mjrun.options.schema import TYPES, Misfit

DeclaredAt = Callable[[Path], type[Options]]  # returns the options at a place of a document

# Keys of earlier versions, and their replacements.
RENAMED = {
    "films": "videos",
    "stills": "images",
    "recording": "recordings, a list",
    "at": "time",
    "groups": "geomgroup, sitegroup, jointgroup, …",
}
# Places whose keys are names that may contain dots.
NAMED = (
    *("set", "qpos", "qvel", "ctrl", "vary", "metrics", "free", "changes"),
    *("reset.qpos", "reset.qvel", "reset.ctrl", "reset.noise", "reset.set", "reset.vary"),
)


def document_error(faults: Iterable[Fault], more: Sequence[Problem] = ()) -> DocumentError:
    """Returns the error with all `faults`, ordered by place, and `more` problems from other documents."""
    return DocumentError([*(_problem(fault) for fault in sorted(set(faults))), *more])


def _problem(fault: Fault) -> Problem:
    # An assignment already contains the path.
    named = not fault.mark.line and fault.mark.source.startswith(f"{fault.path}=")
    return Problem(str(fault.mark), "" if named else fault.path, fault.message)


def misfit_faults(misfits: Iterable[Misfit], tree: Node, more_keys: Sequence[str] = ()) -> list[Fault]:
    """Returns the faults of misfits in `tree` that are not reported yet; `more_keys` are additional top-level keys."""
    nodes = ((misfit, find(tree, misfit.path)) for misfit in misfits)
    return [_fault(misfit, node, tree, more_keys) for misfit, node in nodes if not isinstance(node, InvalidNode)]


def _fault(misfit: Misfit, node: Node, tree: Node, more_keys: Sequence[str]) -> Fault:
    path = misfit.path
    if misfit.keys is not None:
        keys = [*misfit.keys, *(more_keys if len(path) == 1 and misfit.keys else ())]
        return Fault(key_mark(tree, path), path_text(path[:-1]), _unknown(str(path[-1]), keys))
    if misfit.error:
        return fault_at(tree, (*path, *misfit.error.path), misfit.error)
    if misfit.message:
        return Fault(node.mark, path_text(path), spelled(misfit.message))
    hint = misfit.hint
    if misfit.expected == TYPES["string"] and isinstance(node, ScalarNode) and node.text:
        hint = f"; to write text, use quotes: {quoted(shortened(node.text))}"
    return Fault(node.mark, path_text(path), f"expected {misfit.expected}, got {described(node)}{hint}")


def _unknown(key: str, keys: Sequence[str]) -> str:
    if key in RENAMED:
        return f"unknown key {quoted(key)}: it was renamed to {RENAMED[key]}"
    choices = f"; keys: {listing(keys)}" if keys else ""
    return f"unknown key {quoted(shortened(key))}{suggestion(key, keys)}{choices}"


def fault_at(tree: Node, path: Path, error: UsageError) -> Fault:
    """Returns the fault for `error` at the place that `path` leads to."""
    path = written_path(tree, path)
    owners = [tuple(owner.split(".")) for owner in NAMED]
    named = any(path[: len(owner)] == owner and len(path) > len(owner) for owner in owners)
    mark = key_mark(tree, path) if named else find(tree, path).mark
    return Fault(mark, path_text(path), error.one_line(error.path))


def option_fault(tree: MappingNode, place: Path, error: UsageError, declared_at: DeclaredAt) -> Fault:
    """Returns the fault for `error` at its option below `place`."""
    return fault_at(tree, (*place, *_entry_path(tree, place, error.path, declared_at(place))), error)


def _entry_path(tree: MappingNode, place: Path, path: Path, declared: type[Options]) -> Path:
    """Converts `path` to the document's keys and indices; a text such as 'ctrl,energy' in a list is one item."""
    each = next((each for each in document_options(declared) if path and each.name == path[0]), None)
    if each is None:
        return path
    kind, entries = each.kind, find(tree, (*place, each.key))
    match path:
        case (_, int() as index, *rest) if isinstance(entries, ListNode) and isinstance(kind, Several) and kind.commas:
            counts = [len(cast("tuple[object, ...]", kind.parse(str(plain(entry))))) for entry in entries.items]
            owners = [i for i, count in enumerate(counts) for _ in range(count)]
            return (each.key, owners[index], *rest)
        case _:
            return (each.key, *path[1:])
