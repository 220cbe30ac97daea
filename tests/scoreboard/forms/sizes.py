"""Counts and sizes that would fill any memory, or take any time."""

from collections.abc import Iterator

from tests.scoreboard.data import inputs_of
from tests.scoreboard.forms.form import EITHER, REFUSED, Form, simple

HINGE = '<worldbody><body name="b"><joint name="j"/><geom name="g" size=".1"/></body></worldbody>'
BALL = '<geom size=".1"/>'
# Compiled or not, in the memory that the process has.
ENDLESS = {
    "replicate": '<worldbody><replicate count="{0}" offset="1 0 0">' + BALL + "</replicate></worldbody>",
    "flexcomp": '<worldbody><flexcomp name="f" type="grid" dim="2" count="{0} 2 1" spacing=".1 .1 .1"/></worldbody>',
    "flexcomp circle": "<worldbody>"
    '<flexcomp name="f" type="circle" dim="1" count="{0} 1 1" spacing=".1 .1 .1"/></worldbody>',
    "nkey": '<size nkey="{0}"/>' + HINGE,
    "nuserdata": '<size nuserdata="{0}"/>',
    "nuser_body": '<size nuser_body="{0}"/>' + HINGE,
    "nuser_jnt": '<size nuser_jnt="{0}"/>' + HINGE,
    "nuser_geom": '<size nuser_geom="{0}"/>' + HINGE,
    "nuser_site": '<size nuser_site="{0}"/>' + HINGE.replace("<geom", "<site/><geom"),
    "nuser_cam": '<size nuser_cam="{0}"/>' + HINGE.replace("<geom", "<camera/><geom"),
    "nuser_tendon": '<size nuser_tendon="{0}"/>'
    + HINGE
    + '<tendon><fixed><joint joint="j" coef="1"/></fixed></tendon>',
    "nuser_actuator": '<size nuser_actuator="{0}"/>' + HINGE + '<actuator><motor joint="j"/></actuator>',
    "nuser_sensor": '<size nuser_sensor="{0}"/>' + HINGE + '<sensor><jointpos joint="j"/></sensor>',
    "nstack": '<size nstack="{0}"/>',
    "njmax": '<size njmax="{0}"/>' + HINGE,
    "nconmax": '<size nconmax="{0}"/>' + HINGE,
    "memory": '<size memory="{0}"/>' + HINGE,
    "rows of a height field": '<asset><hfield name="h" nrow="{0}" ncol="{0}" size="1 1 1 1"/></asset>',
    "texture": '<asset><texture name="t" type="2d" builtin="flat" width="{0}" height="{0}"/></asset>',
    "cube texture": '<asset><texture name="t" type="cube" builtin="gradient" width="{0}" height="{0}"/></asset>',
    "size of a numeric": '<custom><numeric name="n" size="{0}"/></custom>',
    "sphere as a mesh": '<asset><mesh name="m" builtin="sphere" params="{0}"/></asset>',
    "plate as a mesh": '<asset><mesh name="m" builtin="plate" params="{0} {0}"/></asset>',
    "history of an actuator": HINGE + '<actuator><motor joint="j" nsample="{0}" delay="1"/></actuator>',
    "history of a sensor": HINGE + '<sensor><jointpos joint="j" nsample="{0}" delay="1"/></sensor>',
    "actuator's actdim": HINGE + '<actuator><general joint="j" dyntype="user" actdim="{0}"/></actuator>',
    "sensor's dim": HINGE + '<sensor><user name="u" dim="{0}"/></sensor>',
}
COUNTS = ("65536", "100000000", "2147483647", "4294967297", "-5")
INPUTS = inputs_of(__name__)
DRAWN_SIZES = INPUTS["DRAWN_SIZES"]
SDF = INPUTS["SDF"]


def forms() -> Iterator[Form]:
    for place, text in ENDLESS.items():
        # MuJoCo compiles 8,000 copies in a few seconds.
        for count in ("8000", *COUNTS[1:]) if place == "replicate" else COUNTS:
            loads = REFUSED if count in ("2147483647", "4294967297") and place in ("replicate", "nkey") else EITHER
            yield simple(f"{count} as {place}", text.replace("{0}", count), loads, runs=frozenset({0, 3, 4}))
    for place, text in DRAWN_SIZES.items():
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
