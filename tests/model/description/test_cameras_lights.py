"""Theorems about described cameras: they are what the source says."""

from collections.abc import Callable

from mjrun.model.description.model_description import ModelDescription


def test_a_camera_has_an_angle_a_height_or_a_sensor(described: Callable[[str], ModelDescription]) -> None:
    usual, flat, lens, follower = described("""<mujoco><worldbody><camera fovy="30"/>
        <camera name="flat" projection="orthographic" fovy="2"/><camera sensorsize=".04 .03" focal=".05 .06"
        principal=".001 0" resolution="640 480" output="rgb depth"/><body name="b"><geom size="1"/></body>
        <camera mode="targetbody" target="b"/></worldbody></mujoco>""").cameras
    assert (usual.name, usual.fovy, usual.height, usual.sensor_size) == ("camera:0", 30, None, None)
    assert (flat.fovy, flat.height, flat.projection) == (None, 2, "orthographic")
    assert (lens.fovy, lens.sensor_size, lens.focal_length) == (None, (0.04, 0.03), (0.05, 0.06))
    assert (lens.principal_point, lens.resolution, lens.outputs) == ((0.001, 0), (640, 480), ("rgb", "depth"))
    assert (follower.mode, follower.target, follower.body) == ("targetbody", "b", "world")
