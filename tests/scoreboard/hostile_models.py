"""Hostile models and archives, each through several commands."""

import re
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from mjrun.errors import clean
from tests.scoreboard.command import QUICK_IMPORTS, CommandServer, Ended, modules_of_mjrun
from tests.scoreboard.data import inputs_of
from tests.scoreboard.every_model import BARE_MUJOCO, LOADS, NOT_FINITE, working_backend
from tests.scoreboard.forms import all_forms, quick_forms
from tests.scoreboard.forms.form import EITHER, LOADED, REFUSED, USAGE, Codes, Form
from tests.scoreboard.measure import Tally, lanes, measured, side_by_side

LIMIT = 90.0  # [s] far more than any form takes on a busy machine
MEMORY = 4096  # [MiB] of address space
SECTIONS = inputs_of(__name__)["SECTIONS"]
# Control characters, and those that change the direction of a text: a terminal acts on them.
ACTED_ON = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\u2028\u2029]")
FORGED = re.compile("^mjrun: error: second", re.MULTILINE)  # a second line out of a name
CHECKED = 12  # one form in 12 is checked, which takes a process; and all circles


@measured(
    "hostile models and archives",
    "expected exit code; no hang, no silent failure, no control byte to a terminal; the file is named",
    400,
)
def hostile_models(quick: bool) -> Tally:
    """Tries all forms with two servers that work at once; quickly, a few forms."""
    tally = Tally()
    cases = list(quick_forms() if quick else all_forms())
    for ended, faults in side_by_side(lambda part: _try_all(part, quick), lanes(cases, quick)):
        tally.expect(not faults, f"{ended}: {'; '.join(faults)}")
    if not quick and not working_backend():
        tally.leave_out("rendering: no backend works here")
    return tally


def _try_all(cases: Sequence[tuple[str, Form]], quick: bool) -> Iterator[tuple[str, list[str]]]:
    backend = "" if quick else working_backend()
    with CommandServer(LIMIT, MEMORY, QUICK_IMPORTS if quick else modules_of_mjrun()) as server:
        for i, (group, form) in enumerate(cases):
            checked = not quick and (i % CHECKED == 0 or "circle" in group)
            for ended, faults in _try(server, form, backend, checked):
                yield f"{group}: {form.name}: {ended}", faults


def _try(server: CommandServer, form: Form, backend: str, checked: bool) -> Iterator[tuple[Ended, list[str]]]:
    """Runs all commands on one form; yields each result with its faults."""
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
    """Returns the exit codes that follow from MuJoCo's own verdict; a model on which it dies or hangs must be refused.

    Numbers that are not finite are refused where they affect the motion.
    """
    bare = server.run(model, folder=folder, call=BARE_MUJOCO)
    return {LOADS: LOADED, NOT_FINITE: EITHER}.get(-1 if bare.code is None else bare.code, REFUSED)


def _judged(ended: Ended, form: Form, codes: Codes) -> tuple[Ended, list[str]]:
    """Returns a run with its faults."""
    faults = ended.faults_unless(codes)
    output = ended.stdout.decode("utf-8", "replace")
    for stream, text in (("standard output", output), ("standard error", ended.message)):
        if ACTED_ON.search(text):
            faults.append(f"characters that control a terminal on {stream}")
        if FORGED.search(text):
            faults.append(f"a forged line on {stream}")
    names = (clean(Path(name).name)[:60] for name in (form.model, *form.files))
    names_file = any(name in ended.output for name in names)
    if ended.code == 3 and not names_file and "memory r" not in ended.output:  # of the machine
        faults.append("the refusal names no file")
    return ended, faults
