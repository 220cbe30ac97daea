"""Hostile models and archives, each through several commands: the exit code, a word, and nothing raw to a terminal."""

import re
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mjrun.errors import clean
from tests.scoreboard.backend import working_backend
from tests.scoreboard.bare_mujoco import LOADS, NOT_FINITE
from tests.scoreboard.command import CommandServer, Ended, modules_of_mjrun
from tests.scoreboard.data import inputs_of
from tests.scoreboard.forms import all_forms, quick_forms
from tests.scoreboard.forms.form import EITHER, LOADED, REFUSED, USAGE, Codes, Form
from tests.scoreboard.measure import Measure, Tally

LIMIT = 90.0  # [s] far beyond what any form takes on a busy machine
MEMORY = 4096  # [MiB] of addresses
INPUTS = inputs_of(__name__)
QUICK_IMPORTS = INPUTS["QUICK_IMPORTS"]
SECTIONS = INPUTS["SECTIONS"]
# What a terminal acts on: control characters, and those that turn the direction of a text.
ACTED_ON = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\u2028\u2029]")
FORGED = re.compile("^mjrun: error: second", re.MULTILINE)  # a second line out of a name
CHECKED = 12  # one form in so many is checked, which takes a process; and all that are about circles


def run(quick: bool) -> Tally:
    """Tries all forms, or a few; two servers work at once."""
    tally = Tally()
    cases = list(quick_forms() if quick else all_forms())
    halves = [cases] if quick else [cases[::2], cases[1::2]]
    with ThreadPoolExecutor(len(halves)) as threads:
        for results in threads.map(lambda half: list(_try_all(half, quick)), halves):
            for ended, faults in results:
                tally.expect(not faults, f"{ended}: {'; '.join(faults)}")
    if not working_backend():
        tally.left_out.append("drawing: no backend works here")
    return tally


def _try_all(cases: Sequence[tuple[str, Form]], quick: bool) -> Iterator[tuple[str, list[str]]]:
    backend = "" if quick else working_backend()
    with CommandServer(LIMIT, MEMORY, QUICK_IMPORTS if quick else modules_of_mjrun()) as server:
        for i, (group, form) in enumerate(cases):
            checked = not quick and (i % CHECKED == 0 or "circle" in group)
            for ended, faults in _try(server, form, backend, checked):
                yield f"{group}: {form.name}: {ended}", faults


def _try(server: CommandServer, form: Form, backend: str, checked: bool) -> Iterator[tuple[Ended, list[str]]]:
    """All commands on one form, each with what is wrong with how it ended."""
    with tempfile.TemporaryDirectory(prefix="form") as name:
        folder = Path(name)
        form.write(folder)
        model = form.model if form.model.startswith("./") else f"./{form.model}"
        loads = form.loads or _verdict(server, model, folder)
        runs = (form.runs if 0 in loads else frozenset[int]()) | (loads - LOADED)

        yield _judged(server.run("info", model, *SECTIONS, folder=folder), form, loads)
        trace = server.run("trace", model, "--steps", "3", folder=folder)
        yield _judged(trace, form, runs)
        if form.drawn and backend:
            drawn = form.draws | (loads - LOADED) | (runs & REFUSED)
            image = ("image", model, "--size", "64x48", "--gl", backend, "-o", "image.png")
            yield _judged(server.run(*image, folder=folder), form, drawn)
        if checked:
            folder_of_models = (folder / model).is_dir()
            codes = USAGE if folder_of_models else frozenset({0, 1, 3}) if 0 in loads else REFUSED
            yield _judged(server.run("check", model, "--steps", "3", folder=folder), form, codes)


def _verdict(server: CommandServer, model: str, folder: Path) -> Codes:
    """What MuJoCo says of a model by itself; one on which it dies or hangs must be refused.

    Numbers that are not finite are refused where motion comes of them.
    """
    bare = server.run(model, folder=folder, call="tests.scoreboard.bare_mujoco:load")
    return {LOADS: LOADED, NOT_FINITE: EITHER}.get(-1 if bare.code is None else bare.code, REFUSED)


def _judged(ended: Ended, form: Form, codes: Codes) -> tuple[Ended, list[str]]:
    """A run with what is wrong about it."""
    faults = list(ended.faults)
    if ended.code not in codes:
        faults.append(f"exit code {ended.code}, not {' or '.join(map(str, sorted(codes)))}")
    output = ended.stdout.decode("utf-8", "replace")
    for stream, text in (("standard output", output), ("standard error", ended.message)):
        if ACTED_ON.search(text):
            faults.append(f"what a terminal acts on, on {stream}")
        if FORGED.search(text):
            faults.append(f"a forged line on {stream}")
    names = (clean(Path(name).name)[:60] for name in (form.model, *form.files))
    said = ended.message + output
    if ended.code == 3 and "memory ran out" not in said and not any(name in said for name in names):  # of the machine
        faults.append("the refusal names no file")
    return ended, faults


MEASURE = Measure(
    "hostile models and archives",
    "expected exit code; no hang, no end without a word, no control byte to a terminal; the file is named",
    400,
    run,
)
