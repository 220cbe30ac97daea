"""Tasks small enough to be stepped often."""

from pathlib import Path

CART = """<mujoco><option timestep="0.01"/>
  <worldbody><body name="cart"><joint name="slide" type="slide" axis="1 0 0" damping=".1"/><geom size=".1"/>
  <body name="pole"><joint name="hinge" axis="0 1 0" range="-90 90"/>
  <geom type="capsule" size=".03" fromto="0 0 0 0 0 .6"/>
  </body></body></worldbody>
  <actuator><motor name="push" joint="slide" gear="2" ctrlrange="-1 2"/><motor name="turn" joint="hinge"/></actuator>
</mujoco>"""
DOCUMENT = """
model: cart.xml
control_dt: 0.02
duration: 0.2
reset: {noise: {"qpos/*": "uniform(-0.3, 0.3)"}}
observations:
  - {name: joints, joints: ["*"], clip: [-4, 5]}
  - {name: speed, joints: ["*"], of: qvel}
actions:
  - {actuators: push, scale: 0.5}
  - {joints: hinge, target: position, kp: 5, kd: 0.1}
rewards:
  near: exp(-norm(qpos/slide, xpos/pole/z))
  effort: {value: "sum('action/*'^2)", weight: -0.1}
terminations:
  fallen: {when: abs(qpos/hinge) > 0.5, as: failure}
  there: {when: qpos/slide > 0.27, as: success}
"""


def write_cart(folder: Path) -> Path:
    """The document of a task in `folder`, whose episodes end in every way there is."""
    (folder / "cart.xml").write_text(CART)
    (folder / "task.yaml").write_text(DOCUMENT)
    return folder / "task.yaml"
