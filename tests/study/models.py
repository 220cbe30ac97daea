"""Models that studies simulate."""

BALL = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>
<body name="ball" pos="0 0 .3"><freejoint name="ball"/><geom name="ball" size=".1"/></body></worldbody></mujoco>"""
PENDULUM = """<mujoco><option timestep="0.01"/><worldbody><body name="arm"><joint name="hinge" axis="0 1 0"/>
<geom name="bob" size=".1" pos="0 0 -1"/></body></worldbody>
<actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""
# MuJoCo ends the process that loads it, by SIGSEGV: a bowl of infinite size.
DEADLY = """<mujoco><extension><plugin plugin="mujoco.sdf.bowl"><instance name="bowl"><config key="radius" value="inf"/>
</instance></plugin></extension><asset><mesh name="bowl"><plugin instance="bowl"/></mesh></asset>
<worldbody><body name="ball"><freejoint name="ball"/><geom name="ball" size=".1"/></body></worldbody></mujoco>"""
# The ball with so much memory for contacts: 1M is enough; with 3K MuJoCo gives up in a step, with 1K it goes on
# without them, and 800T it cannot have at all.
BALL_WITH_MEMORY = BALL.replace("<mujoco>", '<mujoco><size memory="MEMORY"/>')
