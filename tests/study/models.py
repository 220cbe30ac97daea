"""Models that studies simulate."""

BALL = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>
<body name="ball" pos="0 0 .3"><freejoint name="ball"/><geom name="ball" size=".1"/></body></worldbody></mujoco>"""
PENDULUM = """<mujoco><option timestep="0.01"/><worldbody><body name="arm"><joint name="hinge" axis="0 1 0"/>
<geom name="bob" size=".1" pos="0 0 -1"/></body></worldbody>
<actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""
# MuJoCo ends the process that loads it: a model that attaches itself.
SUICIDAL = """<mujoco><asset><model name="m" file="suicidal.xml"/></asset><worldbody><body><attach model="m" body="b"
prefix="x"/></body><body name="b"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
# The ball with so much memory for contacts: 1M is enough; with 3K MuJoCo gives up in a step, with 1K it goes on
# without them, and 800T it cannot have at all.
BALL_WITH_MEMORY = BALL.replace("<mujoco>", '<mujoco><size memory="MEMORY"/>')
