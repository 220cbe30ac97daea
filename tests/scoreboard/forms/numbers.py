"""Numbers that cannot be: not finite, negative, far too large, no numbers at all, wherever a model takes one."""

import itertools
from collections.abc import Iterator

from tests.scoreboard.forms.form import DRAWN, REFUSED, RUNS, Form, mjcf

VALUES = ("nan", "inf", "-inf", "-1", "0", "1e308", "1e-320", "1e999", "99999999999", "", "1,5", "0x10", "one")
BODY = '<body name="b"><joint name="j" {joint}/><geom name="g" {geom}/>{body}</body>'
PLACES = {
    "timestep": '<option timestep="{0}"/>',
    "gravity": '<option gravity="0 0 {0}"/>',
    "wind": '<option wind="0 0 {0}" density="1"/>',
    "density of air": '<option density="{0}" viscosity="{0}"/>',
    "tolerance": '<option tolerance="{0}"/>',
    "iterations": '<option iterations="{0}"/>',
    "impratio": '<option impratio="{0}"/>',
    "extent": '<statistic extent="{0}"/>',
    "memory": '<size memory="{0}"/>',
    "znear": '<visual><map znear="{0}"/></visual>',
    "fovy of all": '<visual><global fovy="{0}"/></visual>',
    "offscreen width": '<visual><global offwidth="{0}"/></visual>',
    "shadow size": '<visual><quality shadowsize="{0}"/></visual>',
    "multisampling": '<visual><quality offsamples="{0}"/></visual>',
    "slices": '<visual><quality numslices="{0}"/></visual>',
    "camera's fovy": '<worldbody><camera name="c" fovy="{0}"/></worldbody>',
    "camera's position": '<worldbody><camera name="c" pos="0 0 {0}"/></worldbody>',
    "light": '<worldbody><light pos="0 0 {0}" cutoff="{0}"/></worldbody>',
    "material": '<asset><material name="m" rgba="{0} 0 0 1" shininess="{0}"/></asset>',
    "texture's width": '<asset><texture name="t" type="2d" builtin="flat" width="{0}" height="4"/></asset>',
    "height field's rows": '<asset><hfield name="h" nrow="{0}" ncol="2" size="1 1 1 1"/></asset>',
    "height field's size": '<asset><hfield name="h" nrow="2" ncol="2" size="{0} 1 1 1"/></asset>',
    "mesh's scale": '<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1" scale="{0} 1 1"/></asset>',
    "mesh's vertex": '<asset><mesh name="m" vertex="0 0 {0} 1 0 0 0 1 0 0 0 1"/></asset>',
    "replicate": '<worldbody><replicate count="2" offset="{0} 0 0"><geom size=".1"/></replicate></worldbody>',
    "flexcomp's spacing": "<worldbody>"
    '<flexcomp name="f" dim="2" type="grid" count="2 2 1" spacing="{0} .1 .1"/></worldbody>',
}
ON_BODY = {
    "size": ("", 'size="{0}"', ""),
    "capsule": ("", 'type="capsule" size=".1" fromto="0 0 0 0 0 {0}"', ""),
    "mass": ("", 'size=".1" mass="{0}"', ""),
    "density": ("", 'size=".1" density="{0}"', ""),
    "friction": ("", 'size=".1" friction="{0}"', ""),
    "position": ("", 'size=".1" pos="0 0 {0}"', ""),
    "quaternion": ("", 'size=".1" quat="{0} 0 0 0"', ""),
    "colour": ("", 'size=".1" rgba="{0} 0 0 1"', ""),
    "margin": ("", 'size=".1" margin="{0}"', ""),
    "solref": ("", 'size=".1" solref="{0} 1"', ""),
    "group": ("", 'size=".1" group="{0}"', ""),
    "inertia": ("", 'size=".1"', '<inertial pos="0 0 0" mass="1" diaginertia="{0} 1 1"/>'),
    "body's mass": ("", 'size=".1"', '<inertial pos="0 0 0" mass="{0}" diaginertia="1 1 1"/>'),
    "site": ("", 'size=".1"', '<site name="s" size="{0}"/>'),
    "axis": ('axis="{0} 0 0"', 'size=".1"', ""),
    "range": ('range="0 {0}" limited="true"', 'size=".1"', ""),
    "stiffness": ('stiffness="{0}" springref="1"', 'size=".1"', ""),
    "damping": ('damping="{0}"', 'size=".1"', ""),
    "armature": ('armature="{0}"', 'size=".1"', ""),
    "reference": ('ref="{0}"', 'size=".1"', ""),
}
BEHIND = {  # elements behind a body with a hinge j and a geom g
    "qpos of a keyframe": '<keyframe><key name="k" qpos="{0}"/></keyframe>',
    "qvel of a keyframe": '<keyframe><key name="k" qvel="{0}"/></keyframe>',
    "time of a keyframe": '<keyframe><key name="k" time="{0}"/></keyframe>',
    "gain": '<actuator><motor name="m" joint="j" gear="{0}"/></actuator>',
    "kp": '<actuator><position name="m" joint="j" kp="{0}"/></actuator>',
    "time constant": '<actuator><general name="m" joint="j" dyntype="filter" dynprm="{0}"/></actuator>',
    "control range": '<actuator><motor name="m" joint="j" ctrlrange="0 {0}"/></actuator>',
    "cutoff of a sensor": '<sensor><jointpos joint="j" cutoff="{0}"/></sensor>',
    "noise of a sensor": '<sensor><jointpos joint="j" noise="{0}"/></sensor>',
    "coefficient of a tendon": '<tendon><fixed name="t" stiffness="1"><joint joint="j" coef="{0}"/></fixed></tendon>',
    "width of a tendon": '<tendon><fixed name="t" width="{0}"><joint joint="j" coef="1"/></fixed></tendon>',
    "equality": '<equality><joint joint1="j" polycoef="{0} 0 0 0 0"/></equality>',
    "numeric": '<custom><numeric name="n" data="{0}"/></custom>',
}
# What loads, and cannot be simulated, or drawn.
UNSIMULATED = {("1e308", "reference")}
UNDRAWN = {("nan", "znear"), *((value, "fovy of all") for value in ("nan", "inf", "-inf", "-1", "1e-320"))}
CAMERAS = (
    "fovy",
    "znear",
    "light",
    "colour",
    "extent",
    "camera's position",
    "shadow size",
    "multisampling",
    "slices",
    "size",
)


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
