"""Hostile recordings: sizes that lie, states of other models, states that are not finite."""

import json
from collections.abc import Iterator

import mujoco
import numpy as np

from tests.scoreboard.data import inputs_of
from tests.scoreboard.input_forms import Form
from tests.scoreboard.table_forms import Bomb, archive, cut, flipped, header, npy

INPUTS = inputs_of(__name__)
READERS = INPUTS["READERS"]
ROWS = 3


def _good(model: str) -> dict[str, bytes]:
    """Returns the arrays of a recording of a model, as mjrun writes them."""
    from mjrun.model.source import model_fingerprint

    compiled = mujoco.MjModel.from_xml_string(model)
    data = mujoco.MjData(compiled)
    size = mujoco.mj_stateSize(compiled, mujoco.mjtState.mjSTATE_INTEGRATION)
    states = np.zeros((ROWS, size))
    for row in states:
        mujoco.mj_getState(compiled, data, row, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_step(compiled, data)
    facts = {"mjrun": "0.1.0", "model": model_fingerprint(compiled), "timestep": compiled.opt.timestep}
    return {"states.npy": npy(states), "steps.npy": npy(np.arange(ROWS)), "facts.npy": npy(np.array(json.dumps(facts)))}


def forms(model: str) -> Iterator[Form]:
    good = _good(model)
    size = np.load(__import__("io").BytesIO(good["states.npy"])).shape[1]
    zeros, steps = np.zeros((ROWS, size)), np.arange(ROWS)

    def with_value(value: float) -> bytes:
        states = zeros.copy()
        states[1, 1] = value
        return npy(states)

    def facts(value: object) -> bytes:
        return npy(np.array(value if isinstance(value, str) else json.dumps(value)))

    changes: dict[str, dict[str, bytes | None]] = {
        "no states": {"states.npy": None},
        "no steps": {"steps.npy": None},
        "no facts": {"facts.npy": None},
        "one number less in a state": {"states.npy": npy(np.zeros((ROWS, size - 1)))},
        "no numbers in a state": {"states.npy": npy(np.zeros((ROWS, 0)))},
        "a million numbers in a state": {"states.npy": npy(np.zeros((ROWS, 10**6)))},
        "no state": {"states.npy": npy(np.zeros((0, size))), "steps.npy": npy(np.arange(0))},
        "more states than steps": {"states.npy": npy(np.zeros((9, size)))},
        "a state that is no number": {"states.npy": with_value(np.nan)},
        "an infinite state": {"states.npy": with_value(np.inf)},
        "states of single precision": {"states.npy": npy(zeros.astype(np.float32))},
        "states in three dimensions": {"states.npy": npy(zeros[None])},
        "states that unpickle": {"states.npy": npy(np.array([Bomb()], object))},
        "facts that unpickle": {"facts.npy": npy(np.array(Bomb(), object))},
        "steps that unpickle": {"steps.npy": npy(np.array([Bomb()] * ROWS, object))},
        "steps that fall": {"steps.npy": npy(steps[::-1])},
        "steps from 1 on": {"steps.npy": npy(steps + 1)},
        "steps below 0": {"steps.npy": npy(-steps)},
        "a step twice": {"steps.npy": npy(steps * 0)},
        "steps that are texts": {"steps.npy": npy(np.array(["a"] * ROWS))},
        "10^15 states": {"states.npy": header("'<f8'", f"({10**15}, {size})")},
        "2^62 numbers in a state": {"states.npy": header("'<f8'", f"(4, {2**62})")},
        "states by the column": {"states.npy": npy(np.asfortranarray(zeros + np.arange(size)))},
        "facts that are no JSON": {"facts.npy": facts("{")},
        "facts that are a list": {"facts.npy": facts([])},
        "facts that are deep": {"facts.npy": facts("[" * 50_000)},
        "facts of 2^60 characters": {"facts.npy": header(f"'<U{2**60}'", "()")},
        "a header that is code": {"states.npy": header("__import__('os')", "(3, 9)")},
    }
    codes = {"diff": (7,), "ghost": (2, 7)}
    for index, (what, changed) in enumerate(changes.items()):
        members = {name: content for name, content in {**good, **changed}.items() if content is not None}
        readers = READERS if index % 7 == 4 else ("trace", list(READERS)[1 + index % (len(READERS) - 1)])
        for reader in readers:
            expected = codes.get(reader, (2, 7))
            if what in ("one number less in a state", "a million numbers in a state") and reader == "diff":
                expected = (0,)  # the same states, of whatever model
            yield Form(
                f"recording, {what}, {reader}",
                READERS[reader],
                expected,
                {"r.npz": archive(members)},
                quick=index % 4 == 0 and reader == "trace",
            )
    whole = archive(good)
    for share in (0.0, 0.1, 0.5, 0.9, 0.999):
        yield Form(f"recording, cut off at {share:.1%}", READERS["trace"], (7,), {"r.npz": cut(whole, share)})
    for place in (0.2, 0.4, 0.6, 0.95):
        yield Form(
            f"recording, bytes flipped at {place:.0%}", READERS["trace"], (2, 7), {"r.npz": flipped(whole, place)}
        )
    yield Form("recording, packed", READERS["trace"], (7,), {"r.npz": archive(good, packed=True)})
    yield Form("recording, packed", READERS["diff"], (7,), {"r.npz": archive(good, packed=True)})
    escapes = facts({"mjrun": "\x1b[2J", "model": "\x1b]0;x\x07", "timestep": "\x1b[31m", "command": "\x1b[2J"})
    odd = {
        "facts of escape sequences": escapes,
        "facts of wrong types": facts(
            {"timestep": [], "model": {}, "mjrun": 1, "controls": 7, "push": [[]], "engine": 1e400}
        ),
        "no fact": facts({}),
        "another model": facts({"model": "0" * 32, "mjrun": "0.1.0", "timestep": 0.01}),
        "another timestep": facts({"model": "0" * 32, "timestep": 1e-300}),
        "a timestep of none": facts('{"timestep": NaN}'),
    }
    for what, content in odd.items():
        for reader in READERS:
            files = {"r.npz": archive({**good, "facts.npy": content})}
            yield Form(f"recording, {what}, {reader}", READERS[reader], (0, 1, 2, 7), files, quick=reader == "trace")
    far = {"positions of 1e300": 1e300, "positions of 1e15": 1e15}
    for what, value in far.items():
        for reader in READERS:
            files = {"r.npz": archive({**good, "states.npy": with_value(value)})}
            yield Form(f"recording, {what}, {reader}", READERS[reader], (0, 1, 2, 4, 7), files)
    late = {"a last step of 2^62": steps * 2**61, "a last step of 10^9": steps * 5 * 10**8}
    for what, values in late.items():
        for reader in READERS:
            files = {"r.npz": archive({**good, "steps.npy": npy(values)})}
            yield Form(f"recording, {what}, {reader}", READERS[reader], (0, 1, 2, 7), files)
