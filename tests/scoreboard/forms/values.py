"""Impossible numbers and sizes, wherever a model accepts a number."""

import itertools
from collections.abc import Iterator

from tests.scoreboard.data import inputs_of
from tests.scoreboard.forms.form import DRAWN, EITHER, REFUSED, RUNS, Form, mjcf, simple

VALUES = ("nan", "inf", "-inf", "-1", "0", "1e308", "1e-320", "1e999", "99999999999", "", "1,5", "0x10", "one")
BODY = '<body name="b"><joint name="j" {joint}/><geom name="g" {geom}/>{body}</body>'
HINGE = '<worldbody><body name="b"><joint name="j"/><geom name="g" size=".1"/></body></worldbody>'
BALL = '<geom size=".1"/>'
COUNTS = ("65536", "100000000", "2147483647", "4294967297", "-5")
INPUTS = inputs_of(__name__)
SDF = INPUTS["SDF"]
# Values that load, and cannot be simulated, or rendered.
UNSIMULATED = {("1e308", "reference")}
UNDRAWN = {
    ("nan", "znear"),
    ("inf", "extent"),
    *((value, "fovy of all") for value in ("nan", "inf", "-inf", "-1", "1e-320")),
}


def numbers() -> Iterator[Form]:
    """Yields numbers that are impossible: not finite, negative, far too large, or not numbers."""
    texts = {**INPUTS["PLACES"]}
    texts |= {
        place: f"<worldbody>{BODY.format(joint=joint, geom=geom, body=body)}</worldbody>"
        for place, (joint, geom, body) in INPUTS["ON_BODY"].items()
    }
    hinge = "<worldbody>" + BODY.format(joint="", geom='size=".1"', body="") + "</worldbody>"
    texts |= {place: hinge + behind for place, behind in INPUTS["BEHIND"].items()}
    others = itertools.cycle(VALUES[4:])  # two of them for each place
    for place, text in texts.items():
        for value in (*VALUES[:4], *itertools.islice(others, 2)):
            drawn = any(word in place for word in INPUTS["CAMERAS"]) and value in VALUES[:9]
            yield Form(
                f"{value or 'nothing'} as {place}",
                {"model.xml": mjcf(text.replace("{0}", value))},
                runs=REFUSED if (value, place) in UNSIMULATED else RUNS,
                drawn=drawn,
                draws=REFUSED if (value, place) in UNDRAWN else DRAWN,
            )


def sizes() -> Iterator[Form]:
    """Yields counts and sizes that would fill any memory, or take any time."""
    for place, text in INPUTS["ENDLESS"].items():
        # MuJoCo compiles 8,000 copies in a few seconds.
        for count in ("8000", *COUNTS[1:]) if place == "replicate" else COUNTS:
            loads = REFUSED if count in ("2147483647", "4294967297") and place in ("replicate", "nkey") else EITHER
            yield simple(f"{count} as {place}", text.replace("{0}", count), loads, runs=frozenset({0, 3, 4}))
    for place, text in INPUTS["DRAWN_SIZES"].items():
        for count in ("10000", "100000", "100000000", "2147483647", "-5", "0"):
            yield simple(f"{count} as {place}", text.replace("{0}", count), EITHER, drawn=True)
    for memory in ("1500M", "1P", "1E", "16E", "99999999T", "1", "1K", "-1", "1X", "1e9"):
        text = f'<size memory="{memory}"/>{HINGE}'
        yield simple(f"an arena of {memory}", text, runs=frozenset({0, 3, 4}))
    nested = BALL
    for i in range(3):
        nested = f'<replicate count="1000" sep="s{i}" offset="1 0 0">{nested}</replicate>'
    yield simple("replicate within replicate", f"<worldbody>{nested}</worldbody>", REFUSED)
    nested = BALL
    for i in range(40):
        nested = f'<replicate count="2" sep="s{i}" offset="1 0 0">{nested}</replicate>'
    yield simple("replicate that doubles 40 times", f"<worldbody>{nested}</worldbody>", REFUSED)
    for dim, count in ((1, "100000000 1 1"), (3, "1000 1000 1000"), (3, "2000 2000 2000"), (2, "65536 65536 1")):
        text = f'<worldbody><flexcomp name="f" type="grid" dim="{dim}" count="{count}" spacing=".1 .1 .1"/></worldbody>'
        yield simple(f"a flexcomp of {count}", text, REFUSED)
    yield simple(
        "a composite of old",
        '<worldbody><composite type="grid" count="9999 9999 1" spacing=".1"/></worldbody>',
        REFUSED,
    )
    yield simple("30,000 geoms", f"<worldbody>{BALL * 30000}</worldbody>", EITHER)
    yield simple(
        "100,000 numbers of a keyframe", HINGE + f'<keyframe><key qpos="{"1 " * 100000}"/></keyframe>', REFUSED
    )
    yield simple("a million numbers of a numeric", f'<custom><numeric name="n" data="{"1 " * 1000000}"/></custom>')
    yield simple("10,000 excludes", HINGE + "<contact>" + '<exclude body1="world" body2="b"/>' * 10000 + "</contact>")
    yield simple("20,000 cameras", "<worldbody>" + "<camera/>" * 20000 + "</worldbody>")
    yield simple("20,000 keyframes", HINGE + "<keyframe>" + '<key qpos="1"/>' * 20000 + "</keyframe>")
    yield simple("20,000 materials", "<asset>" + "".join(f'<material name="m{i}"/>' for i in range(20000)) + "</asset>")
    yield simple("20,000 sensors", HINGE + "<sensor>" + '<jointpos joint="j"/>' * 20000 + "</sensor>", EITHER)
    for radius in ("inf", "nan", "1e300", "-1"):
        yield simple(f"a torus of radius {radius}", SDF.format("torus", _setting("radius1", radius)))
        small = _setting("radius1", "1") + _setting("radius2", radius)
        yield simple(f"a torus of small radius {radius}", SDF.format("torus", small))
        yield simple(f"an SDF sphere of radius {radius}", SDF.format("sphere", _setting("radius", radius)))


def _setting(key: str, value: str) -> str:
    return f'<config key="{key}" value="{value}"/>'
