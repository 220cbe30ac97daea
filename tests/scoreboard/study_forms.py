"""Hostile plans, parts and manifests of studies."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet

from tests.scoreboard.command import ROOT
from tests.scoreboard.data import inputs_of
from tests.scoreboard.input_forms import BETWEEN, CSV, WRONG, Content, Form

INPUTS = inputs_of(__name__)
STUDY = INPUTS["STUDY"]
TASK = ("sweep", "plan.jsonl", "--task", "1/1")
COLLECT = ("sweep", "plan.jsonl", "--collect")
AGAIN = ("sweep", "study")
POINTS = ("sweep", "m.xml", "--steps", "2", "--points", "p.csv", "--metric", "x=last(qpos/hinge)", "--dry-run")
PLOT = ("plot", "study", "-o", "new.svg")


@cache
def _made(model: str) -> tuple[dict[str, bytes], bytes]:
    """Returns the files of a finished study, and the plan of one that was not run."""
    with TemporaryDirectory() as folder:
        Path(folder, "m.xml").write_text(model)
        command = (sys.executable, "-m", "mjrun")
        environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}
        for more in ((), ("-o", "other", "--plan", "plan.jsonl")):
            subprocess.run((*command, *STUDY, *more), cwd=folder, env=environment, check=True, capture_output=True)
        study = Path(folder, "study")
        files = {f"study/{path.relative_to(study)}": path.read_bytes() for path in study.rglob("*") if path.is_file()}
        return files, Path(folder, "plan.jsonl").read_bytes()


def _lines(plan: bytes, change: Callable[[dict[str, Any]], object]) -> bytes:
    """Returns a plan with every line changed."""
    lines = []
    for text in plan.splitlines():
        line = json.loads(text)
        changed = change(line)
        lines.append(json.dumps(line if changed is None else changed))
    return "\n".join(lines).encode() + b"\n"


def _plans(plan: bytes) -> Iterator[tuple[str, bytes | str, tuple[int, ...]]]:
    def changed(**values: object) -> bytes:
        return _lines(plan, lambda line: line.update(values))

    yield "empty", b"", (2,)
    yield "text", "plan\n", (2,)
    yield "null", "null\n", (2,)
    yield "a list", "[]\n", (2,)
    yield "deep", "[" * 100_000 + "\n", (2,)
    yield "deep within a study", _deep(plan), (2,)
    yield "UTF-16", plan.decode().encode("utf-16"), (2,)
    yield "cut off", plan[: len(plan) // 3], (2,)
    yield "a table", CSV, (2,)
    yield "an integer of 5,000 digits", plan.replace(b'"ranges": [[0, ', b'"ranges": [[0, ' + b"9" * 5000), (2,)
    for what, (values, codes) in INPUTS["PLANS"].items():
        if what == "no hashes":
            yield "other chunks", plan + changed(folder="elsewhere"), (2,)
            for name in ("mjrun", "mujoco", "numpy", "model", "files", "code", "simulation", "metrics", "engine"):
                yield f"another hash of {name}", _lines(plan, partial(_with_other_hash, name=name)), (2,)
        study = values.get("study")
        if isinstance(study, dict) and study:
            yield what, _lines(plan, partial(_with_settings, settings=study)), codes
        else:
            yield what, changed(**values), codes
    for place in ("../../above", "/proc/self/nothing", "m.xml", "a\0b", "", "n" * 300):
        yield f"the folder {place[:20]!a}", changed(folder=place), (2, 7)


def _with_other_hash(line: dict[str, Any], name: str) -> None:
    line["identity"][name] = "\x1b[2J"


def _with_settings(line: dict[str, Any], settings: dict[str, object]) -> None:
    line["study"].update(settings)


def _deep(plan: bytes) -> bytes:
    return plan.replace(b'"steps": 2', b'"steps": ' + b"[" * 900 + b"]" * 900)


def _part(**columns: pyarrow.Array | None) -> Callable[[bytes], Content]:
    """Makes a part with one value in all rows of the changed columns; None removes one."""

    def make(content: bytes) -> Content:
        table = pyarrow.parquet.read_table(pyarrow.BufferReader(content))
        rows = [0] * table.num_rows
        repeated = {name: value and value.take(rows) for name, value in columns.items()}
        values = {name: table[name] for name in table.column_names} | repeated
        kept = {name: value for name, value in values.items() if value is not None}
        return lambda path: pyarrow.parquet.write_table(pyarrow.table(kept), path)

    return make


def _parts() -> Iterator[tuple[str, Callable[[bytes], Content], tuple[int, ...]]]:
    """Yields changes of the first part of a continued study: its points are simulated again, or it is refused."""
    yield "empty", lambda content: b"", (0,)
    yield "cut off", lambda content: content[: len(content) // 2], (0,)
    yield "text", lambda content: CSV, (0,)
    yield "other magic at its end", lambda content: content[:-4] + b"XXXX", (0,)
    yield "bytes flipped", lambda content: content[:60] + bytes(64) + content[124:], (0,)
    yield "a link to another file", lambda content: lambda path: path.symlink_to(f"../../../{BETWEEN}"), (0,)
    yield "a folder", lambda content: lambda path: path.mkdir(), (0, 7)
    yield "a link to nothing", lambda content: lambda path: path.symlink_to("nowhere"), (0, 7)
    yield "keys of other points", _part(key=pyarrow.array([bytes(16)], pyarrow.binary(16))), (0,)
    yield "keys that are texts", _part(key=pyarrow.array(["0" * 32])), (0,)
    yield "keys that are numbers", _part(key=pyarrow.array([1])), (0,)
    yield "keys that are null", _part(key=pyarrow.array([None], pyarrow.string())), (0,)
    yield "keys that are lists", _part(key=pyarrow.array([["a"]])), (0,)
    yield "no keys", _part(key=None), (0,)
    yield "a status nobody knows", _part(status=pyarrow.array(["\x1b[2J"])), (0, 8)
    yield "a status that is a number", _part(status=pyarrow.array([7])), (0, 8)
    yield "a status of null", _part(status=pyarrow.array([None], pyarrow.string())), (0, 8)
    yield "steps in words", _part(steps=pyarrow.array(["many"])), (0, 8)
    yield "steps of null", _part(steps=pyarrow.array([None], pyarrow.int64())), (0, 8)
    yield "an exit code in words", _part(exit_code=pyarrow.array(["x"])), (0, 8)
    yield (
        "a message of escape sequences",
        _part(message=pyarrow.array(["\x1b[2J"]), status=pyarrow.array(["failed"]), exit_code=pyarrow.array([2])),
        (0, 8),
    )
    yield "a message that is a number", _part(message=pyarrow.array([1.5]), status=pyarrow.array(["failed"])), (0, 8)
    yield "a metric in words", _part(**{"metric:x": pyarrow.array(["much"])}), (0, 8)
    yield "a metric that is a list", _part(**{"metric:x": pyarrow.array([[1.0]])}), (0, 8)
    yield "a metric of null", _part(**{"metric:x": pyarrow.array([None], pyarrow.float64())}), (0, 8)
    yield "an infinite metric", _part(**{"metric:x": pyarrow.array([np.inf])}), (0, 8)
    yield "another metric", _part(**{"metric:x": None, "metric:y": pyarrow.array([1.0])}), (0,)
    yield "a wall time in words", _part(wall=pyarrow.array(["long"])), (0, 8)


def _manifests(content: bytes) -> Iterator[tuple[str, bytes | str]]:
    good = json.loads(content)
    yield "empty", ""
    yield "text", "study"
    yield "null", "null"
    yield "deep", "[" * 100_000
    yield "a list", "[]"
    yield "without a study", json.dumps({name: value for name, value in good.items() if name != "study"})
    yield "cut off", content[:80]
    for number, value in enumerate(("text", 7, None, [], {}, {"model": 7}, {"model": "\x1b[2J.xml"})):
        yield f"study {number}", json.dumps({**good, "study": value})
    yield "an unknown key", json.dumps({**good, "study": {**good["study"], "evil": 1}})
    yield "code", json.dumps({**good, "study": {**good["study"], "controller": "evil.py:act"}})
    yield "10^30 steps", json.dumps({**good, "study": {**good["study"], "steps": 10**30}})
    yield "another file for a model", json.dumps({**good, "study": {**good["study"], "model": f"../../{BETWEEN}"}})
    yield "an integer of 5,000 digits", content.replace(b'"steps": 2', b'"steps": ' + b"9" * 5000)
    yield "not a number", content.replace(b'"steps": 2', b'"steps": NaN')


def forms(model: str) -> Iterator[Form]:
    study, plan = _made(model)
    part = next(name for name in study if name.startswith("study/parts/"))
    for index, (what, content, codes) in enumerate(_plans(plan)):
        for line in (TASK, COLLECT) if index % 3 == 0 else (TASK,):
            expected = (0, 2, 3, 7, 8) if line is COLLECT else codes
            yield Form(
                f"plan, {what}, {line[2]}",
                line,
                expected,
                {"plan.jsonl": content},
                quick=line is TASK and index % 6 == 0,
            )
    for what, make, codes in _parts():
        for line in (AGAIN, (*AGAIN, "--collect")):
            files = {**{name: content for name, content in study.items() if name != part}, part: make(study[part])}
            expected = (*codes, 8) if "--collect" in line else codes
            yield Form(f"part, {what}, {' '.join(line)}", line, expected, files, changes=("study/",))
    for index, (what, content) in enumerate(_manifests(study["study/study.json"])):
        for line in (AGAIN, PLOT) if index % 2 else (AGAIN,):
            codes = (0, 2, 3, 7) if line is PLOT else (2, 3, 7)
            files: Mapping[str, Content] = {**study, "study/study.json": content}
            yield Form(f"study.json, {what}, {line[0]}", line, codes, files, quick=line is AGAIN and index % 5 == 0)
    results = {"empty": b"", "cut off": study["study/results.parquet"][:100], "text": CSV.encode()}
    for what, content in results.items():
        yield Form(f"results.parquet, {what}", PLOT, (7,), {**study, "study/results.parquet": content})
    for number, value in enumerate(WRONG):
        text = f"qpos/hinge\n{value}\n"
        yield Form(f"points, {value}", POINTS, (0, 2, 7) if number in (2, 3, 4) else (2, 7), {"p.csv": text})
    for what, content in INPUTS["POINTS"].items():
        codes = (0, 2) if what == "a model elsewhere" else (2, 3, 7)  # it is read when its point is simulated
        yield Form(f"points, {what}", POINTS, codes, {"p.csv": content}, quick=len(what) % 3 == 0)
