"""Numbers that cannot be: not finite, negative, far too large, no numbers at all, wherever a model takes one."""

import itertools
from collections.abc import Iterator

from tests.scoreboard.data import inputs_of
from tests.scoreboard.forms.form import DRAWN, REFUSED, RUNS, Form, mjcf

VALUES = ("nan", "inf", "-inf", "-1", "0", "1e308", "1e-320", "1e999", "99999999999", "", "1,5", "0x10", "one")
BODY = '<body name="b"><joint name="j" {joint}/><geom name="g" {geom}/>{body}</body>'
INPUTS = inputs_of(__name__)
PLACES = INPUTS["PLACES"]
ON_BODY = INPUTS["ON_BODY"]
BEHIND = INPUTS["BEHIND"]
# What loads, and cannot be simulated, or drawn.
UNSIMULATED = {("1e308", "reference")}
UNDRAWN = {("nan", "znear"), *((value, "fovy of all") for value in ("nan", "inf", "-inf", "-1", "1e-320"))}
CAMERAS = INPUTS["CAMERAS"]


def forms() -> Iterator[Form]:
    texts = {**PLACES}
    texts |= {
        place: f"<worldbody>{BODY.format(joint=joint, geom=geom, body=body)}</worldbody>"
        for place, (joint, geom, body) in ON_BODY.items()
    }
    hinge = "<worldbody>" + BODY.format(joint="", geom='size=".1"', body="") + "</worldbody>"
    texts |= {place: hinge + behind for place, behind in BEHIND.items()}
    others = itertools.cycle(VALUES[4:])  # two of them for each place
    for place, text in texts.items():
        for value in (*VALUES[:4], *itertools.islice(others, 2)):
            drawn = any(word in place for word in CAMERAS) and value in VALUES[:9]
            yield Form(
                f"{value or 'nothing'} as {place}",
                {"model.xml": mjcf(text.replace("{0}", value))},
                runs=REFUSED if (value, place) in UNSIMULATED else RUNS,
                drawn=drawn,
                draws=REFUSED if (value, place) in UNDRAWN else DRAWN,
            )
