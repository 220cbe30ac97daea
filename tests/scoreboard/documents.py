"""Hostile tables, recordings, documents, expressions, policies, plans and parts of studies."""

from collections.abc import Iterator
from itertools import chain

from tests.scoreboard import (
    document_forms,
    expression_forms,
    policy_forms,
    recording_forms,
    study_forms,
    table_forms,
)
from tests.scoreboard.input_forms import Content, Form, try_forms
from tests.scoreboard.measure import Measure, Tally

MODEL = """<mujoco><option timestep="0.01"/><worldbody><body name="arm">
<joint name="hinge" axis="0 1 0" damping="0.1"/><geom name="bob" size=".1" pos="0 0 -1"/></body></worldbody>
<actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""
BASE: dict[str, Content] = {"m.xml": MODEL, "good.csv": table_forms.CSV}


def forms() -> Iterator[Form]:
    """All of them."""
    return chain(quick_forms(), study_forms.forms(MODEL))


def quick_forms() -> Iterator[Form]:
    """All that need no study to be run first."""
    return chain(
        table_forms.forms(),
        recording_forms.forms(MODEL),
        document_forms.forms(),
        expression_forms.forms(),
        policy_forms.forms(),
    )


def run(quick: bool) -> Tally:
    tally = Tally()
    if quick:
        try_forms([form for form in quick_forms() if form.quick][::3], BASE, tally)
    else:
        try_forms(forms(), BASE, tally)
    return tally


MEASURE = Measure(
    "hostile tables, recordings, documents, expressions, policies, plans and parts",
    "the expected exit code, no hang, a message, no control bytes, no code run, nothing of other files shown",
    300,
    run,
)
