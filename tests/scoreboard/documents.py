"""Hostile documents and expressions; the measure adds tables, recordings, policies, plans and parts of studies."""

import os
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path

from tests.scoreboard import policy_forms, recording_forms, study_forms, table_forms
from tests.scoreboard.command import QUICK_IMPORTS
from tests.scoreboard.data import inputs_of
from tests.scoreboard.input_forms import (
    BETWEEN,
    CSV,
    LAUGHS,
    MODEL,
    TAGS,
    TASK,
    WRONG,
    Content,
    Form,
    changed,
    try_forms,
)
from tests.scoreboard.measure import Tally, measured

INPUTS = inputs_of(__name__)
COMMANDS: Mapping[str, tuple[str, ...]] = INPUTS["COMMANDS"]
GOOD: Mapping[str, str] = {kind: INPUTS["GOOD"].get(kind, TASK) for kind in COMMANDS}
NUMBERS: Mapping[str, tuple[str, ...]] = INPUTS["NUMBERS"]
BASE: dict[str, Content] = {"m.xml": MODEL, "good.csv": CSV}
SWEEP = ("sweep", "m.xml", "--steps", "2")
METRIC = ("--metric", "x=max(qpos/hinge)")


@measured(
    "hostile tables, recordings, documents, expressions, policies, plans and parts",
    "the expected exit code, no hang, a message, no control bytes, no code run, no other file disclosed",
    300,
)
def documents(quick: bool) -> Tally:
    tally = Tally()
    if quick:
        try_forms([form for form in quick_forms() if form.quick][::18], BASE, tally, QUICK_IMPORTS)
    else:
        try_forms(forms(), BASE, tally)
    return tally


def forms() -> Iterator[Form]:
    """Yields all forms."""
    return chain(quick_forms(), study_forms.forms(MODEL))


def quick_forms() -> Iterator[Form]:
    """Yields all forms that need no study to be run first."""
    return chain(
        table_forms.forms(), recording_forms.forms(MODEL), document_forms(), expression_forms(), policy_forms.forms()
    )


def document_forms() -> Iterator[Form]:
    """Yields documents that are invalid, explode, ask for code or other files, or have wrong types everywhere."""
    kinds = list(COMMANDS)
    for index, (what, text) in enumerate(_texts()):
        names = kinds if index % 7 == 2 else ["run", kinds[1 + index % (len(kinds) - 1)]]
        for name in names:
            content = changed(GOOD[name], text).replace("{laughs}", LAUGHS) if isinstance(text, str) else text
            label, is_quick = f"{name} document, {what}", name == "run" and index % 3 == 0
            yield Form(label, COMMANDS[name], _codes(name, what), {"d.yaml": content}, quick=is_quick)
    yield from _special_files()
    yield from _references()
    yield from _wrong_values()
    for number, text in enumerate(INPUTS["ASSIGNMENTS"]):
        line, files = ("run", "d.yaml", text), {"d.yaml": GOOD["run"]}
        yield Form(f"assignment {text[:40]!a}", line, (2,), files, quick=number % 4 == 0)


def _texts() -> Iterator[tuple[str, bytes | str]]:
    for what, text in INPUTS["TEXTS"].items():
        if what == "a directive":
            yield from ((f"the tag {tag.split()[0]}", f"{{good}}seed: {tag}\n") for tag in TAGS)
        yield what, text


def _codes(name: str, what: str) -> tuple[int, ...]:
    """Returns the right exit codes; a task is distinguished from a model by its content."""
    if what == "a seed of 31 digits":
        return (0, 1, 2, 3)  # any whole number may be a seed
    if name == "task, checked":
        return (1, 2, 3)
    return (2, 3) if name.startswith("task") else (2,)


def _special_files() -> Iterator[Form]:
    makers: dict[str, Content] = {
        "a pipe": lambda path: os.mkfifo(path),
        "an endless device": lambda path: path.symlink_to("/dev/zero"),
        "a folder": lambda path: path.mkdir(),
        "a link to nothing": lambda path: path.symlink_to("nowhere.yaml"),
        "a link to itself": lambda path: path.symlink_to("d.yaml"),
    }
    for name, line in COMMANDS.items():
        for what, make in makers.items():
            yield Form(f"{name} document that is {what}", line, (2, 3, 7), {"d.yaml": make}, quick=name == "run")


def _link_outside(path: Path) -> None:
    path.symlink_to(f"../{BETWEEN}")


def _references() -> Iterator[Form]:
    """Yields documents that name files outside of their folder, or outputs that must not be written."""
    links = {f"link.{suffix}": _link_outside for suffix in ("yaml", "xml", "csv", "npz", "onnx")}
    for what, (change, codes) in INPUTS["REFERENCES"].items():
        kind = "study" if "points" in what else "run"
        files = {**links, "d.yaml": changed(GOOD[kind], change)}
        yield Form(f"document with {what}", COMMANDS[kind], codes, files, quick="link" in what)


def _wrong_values() -> Iterator[Form]:
    """Yields documents with values of wrong types and sizes."""
    for kind, keys in INPUTS["KEYS"].items():
        for number, key in enumerate(keys):
            for step in range(0, len(WRONG), 3):
                value = WRONG[(number + step) % len(WRONG)]
                names_file = value == "../../x" or key == "points"
                codes = (2, 3) if kind == "task" else (2, 7) if names_file else (2,)
                if value in ("null", "[[[]]]", "''"):
                    codes = (0, *codes)  # as if it were missing, where it is optional
                files: dict[str, Content] = {"d.yaml": f"{_without(GOOD[kind], key)}{key}: {value}\n"}
                yield Form(f"{kind} document, {key}: {value}", COMMANDS[kind], codes, files)


def _without(text: str, key: str) -> str:
    """Returns a document without one of its keys and the lines below it."""
    remaining, skipping = [], False
    for line in text.splitlines(keepends=True):
        skipping = line.startswith(f"{key}:") or (skipping and line.startswith(" "))
        if not skipping:
            remaining.append(line)
    return "".join(remaining)


def expression_forms() -> Iterator[Form]:
    """Yields expressions that are deep, huge, code, or made of look-alikes, wherever an expression is accepted."""
    places = list(NUMBERS)
    for index, text in enumerate((*INPUTS["CODE"], *INPUTS["REFUSED"])):
        for place in {"assert", places[index % len(places)]}:
            codes = (2, 7) if place == "map" and text.startswith("@") else (2,)
            line = _with(text, NUMBERS[place])
            yield Form(f"expression {text[:40]!a}, {place}", line, codes, quick=place == "assert")
    # A number may be infinite or NaN: then an assertion fails, a position is invalid, an event never happens.
    accepted = {"assert": (0, 1), "map": (0, 2, 7), "still": (0, 1, 2)}
    for index, text in enumerate(INPUTS["ACCEPTED"]):
        for place in {"assert", places[index % len(places)]}:
            line, codes = _with(text, NUMBERS[place]), accepted.get(place, (0,))
            yield Form(f"expression {text[:40]!a}, {place}", line, codes, quick=index % 3 == 0)
    for text in INPUTS["ELSEWHERE"]:
        yield from _expressions_of_options(text, ascii(text[:30]))
        yield from _expressions_of_documents("'" + text.replace("'", "''").replace("\x1b", "") + "'", ascii(text[:30]))
    for value in INPUTS["RANGES"]:
        yield Form(f"sweep --vary {value}", (*SWEEP, *METRIC, "--dry-run", "--vary", value), (2,))
    for samples in ("1e300", "99999999999999", "-1", "0", "nan"):
        line = (*SWEEP, "--vary", "qpos/hinge=uniform(0,1)", *METRIC, "--samples", samples, "--dry-run")
        yield Form(f"sweep --samples {samples}", line, (2,))


def _with(text: str, line: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(word.replace("{}", text) for word in line)


def _expressions_of_options(text: str, name: str) -> Iterator[Form]:
    for option in ("where", "require", "keep-where"):
        line = (*SWEEP, "--vary", "seed=1,2", *METRIC, "--keep", "trace", f"--{option}", text, "--dry-run")
        yield Form(f"sweep {option.replace('-', ' ')} {name}", line, (2,))
    for option, value in (("--metric", f"x={text}"), ("--require", text)):
        yield Form(f"eval {option} {name}", (*COMMANDS["task"], option, value), (2,), {"d.yaml": TASK})
    for value in (f"joint/hinge.damping={text}", f"{text}=0..1", f"joint/hinge.damping=0.1..1~{text}"):
        yield Form(f"fit --free {value[:40]!a}", ("fit", "m.xml", "good.csv", "--free", value), (2,))
    for value in (f"qpos/hinge={text}", f"{text}=1", f"joint/hinge.damping=uniform({text})"):
        yield Form(f"sweep --vary {value[:40]!a}", (*SWEEP, *METRIC, "--dry-run", "--vary", value), (2,))


def _expressions_of_documents(quoted: str, name: str) -> Iterator[Form]:
    study = GOOD["study"].replace("last(qpos/hinge)", quoted)
    yield Form(f"metric of a document {name}", COMMANDS["study"], (2,), {"d.yaml": study})
    rewards = TASK.replace("rewards: {upright: cos(qpos/hinge)}", f"rewards: {{upright: {quoted}}}")
    yield Form(f"task's rewards {name}", COMMANDS["task, traced"], (2,), {"d.yaml": rewards})
    value = TASK.replace("probe: qpos/hinge", f"value: {quoted}")
    yield Form(f"task's probe {name}", COMMANDS["task, traced"], (2,), {"d.yaml": value})
    terminations = f"{TASK}terminations: {{fallen: {{when: {quoted}}}}}\n"
    yield Form(f"task's termination {name}", COMMANDS["task, checked"], (1, 2, 3), {"d.yaml": terminations})
