"""Kinds of documents, recognized by keys that no other kind has."""

from dataclasses import dataclass
from pathlib import Path

from mjrun.document.tree import Fault, MappingNode, Mark
from mjrun.document.yaml_parser import compose
from mjrun.errors import FileError, quoted
from mjrun.formats.input_file import opened


@dataclass(frozen=True)
class DocumentKind:
    """A kind of document.

    Attributes:
      name: as in "a run document".
      use: the command or option that accepts such a document.
      keys: the keys that only this kind has.
    """

    name: str
    use: str
    keys: frozenset[str]


RUN = ("videos", "images", "traces", "plots", "recordings", "keyframes")
STUDY = ("vary", "points", "metrics", "samples", "sampler")
FIT = ("data", "free", "holdout_data", "excite")
TASK = ("observations", "actions", "rewards", "terminations")
EVALUATION = ("task", "episodes", "compare", "fail_below")

# By the names of their models.
KINDS = {
    "Run": DocumentKind("a run document", "mjrun run", frozenset(RUN)),
    "Study": DocumentKind("a study document", "mjrun sweep", frozenset(STUDY)),
    "Fit": DocumentKind("a fit document", "mjrun fit", frozenset(FIT)),
    "Task": DocumentKind("a task document", "mjrun eval, or mjrun video with a policy", frozenset(TASK)),
    "Evaluation": DocumentKind("an evaluation document", "mjrun eval", frozenset(EVALUATION)),
    "CameraDocument": DocumentKind("a camera script", "the camera of mjrun video", frozenset(("shots",))),
}


def kind_of(tree: MappingNode) -> DocumentKind | None:
    """Returns the kind of document that `tree` is: the only one whose keys it has; None if it is ambiguous.

    An evaluation may have the keys of variations that a study has.
    """
    kinds = [kind for kind in KINDS.values() if not kind.keys.isdisjoint(tree.entries)]
    evaluation = KINDS["Evaluation"]
    if kinds == [KINDS["Study"], evaluation]:
        return evaluation
    return kinds[0] if len(kinds) == 1 else None


def kind_of_file(path: Path | str) -> DocumentKind | None:
    """Returns the kind of the document at `path`; None if it is ambiguous or unreadable, which its reader reports."""
    try:
        with opened(Path(path), "document", ()) as file:
            text = file.read().decode("utf-8-sig")
    except (FileError, UnicodeDecodeError):
        return None
    node, _ = compose(text, lambda index: Mark(0, 0, 0, str(path)))
    return kind_of(node) if isinstance(node, MappingNode) else None


def other_kind(tree: MappingNode, expected: str) -> Fault | None:
    """Returns the fault if `tree` is a document of another kind than `expected`, the name of a model."""
    kind, wanted = kind_of(tree), KINDS.get(expected)
    if kind is None or wanted is None or kind is wanted:
        return None
    key = next(key for key in tree.entries if key in kind.keys)
    message = f"{quoted(key)} makes this {kind.name}, for {kind.use}; expected {wanted.name}"
    return Fault(tree.keys[key], "", message)
