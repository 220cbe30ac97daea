"""The bodies of flexes and skins, against the names that MuJoCo's compiler gives them."""

import mujoco

from mjrun.model.fields import carriers, flex_owners
from tests.cases import cases

FLEX = """<mujoco><worldbody><body name="arm"><geom size=".1"/><flexcomp name="c" type="grid" dim="3" count="2 2 2"
  spacing=".1 .1 .1" radius=".01" mass="1" {attributes}>{pin}<elasticity young="1e4" poisson=".2"/></flexcomp></body>
  <body name="last"><geom size=".1"/></body></worldbody></mujoco>"""


@cases("attributes, pin, owner")
def test_a_flex_belongs_to_a_body_that_carries_it(attributes: str, pin: str, owner: str) -> None:
    model = mujoco.MjModel.from_xml_string(FLEX.format(attributes=attributes, pin=pin))
    (body,) = flex_owners(model)
    assert model.body(body).name == owner
    assert {model.body(each).name[:2] for each in carriers(model, 0)} <= {"c_", "ar"}


def test_a_flex_belongs_to_the_world_only_if_nothing_else_carries_it() -> None:
    cloth = """<mujoco><worldbody><flexcomp name="c" type="grid" dim="2" count="3 3 1" spacing=".1 .1 .1" radius=".01"
      mass="1" {rigid}><edge equality="true"/>{pin}</flexcomp></worldbody></mujoco>"""
    pinned = mujoco.MjModel.from_xml_string(cloth.format(rigid="", pin='<pin id="0 1"/>'))
    rigid = mujoco.MjModel.from_xml_string(
        cloth.format(rigid='rigid="true"', pin="").replace('<edge equality="true"/>', "")
    )
    assert pinned.body(flex_owners(pinned)[0]).name == "c_2"
    assert flex_owners(rigid).tolist() == [0]
