"""Terms of a task are checked in themselves."""

from collections.abc import Callable

import pytest

from mjrun.errors import UsageError, spelled
from mjrun.task.episode import Ending
from mjrun.task.task import TIMED_OUT, UNSTABLE, Action, Command, Observation, Reset, Reward, Termination


@pytest.mark.parametrize(
    ("make", "message", "path"),
    [
        (lambda: Observation(name="x"), "taken from one of probe, joints", ("probe",)),
        (lambda: Observation(name="x", probe="qpos", value="1"), "not probe and value", ("value",)),
        (lambda: Observation(name="x", probe="qpos", of="qvel"), "of applies only with joints", ("of",)),
        (lambda: Observation(name="x", probe="qpos", noise="gauss(1, 2)"), "no distribution gauss", ("noise",)),
        (lambda: Observation(name="x", probe="qpos", noise="choice(a, b)"), "neither a number", ("noise",)),
        (lambda: Action(), "drives one of actuators, joints", ("actuators",)),
        (lambda: Action(actuators="*", joints="*"), "exclude each other", ("joints",)),
        (lambda: Action(joints="*"), "joints requires a target", ("target",)),
        (lambda: Action(actuators="*", target="torque"), "target torque applies only with joints", ("target",)),
        (lambda: Action(joints="*", target="position", kp=1), "requires kd", ("target",)),
        (lambda: Action(joints="*", target="torque", kp=1), "kp is not a gain of the target torque", ("kp",)),
        (lambda: Command(), "comes from one of", ("constant",)),
        (lambda: Command(constant=1, size=2), "size applies only with random", ("size",)),
        (lambda: Command(random=["uniform(0, 1)"] * 2, size=3), "has 2 distributions, not 3", ("size",)),
        (lambda: Reset(noise={"qpos/*": "b"}), "neither a number nor a distribution", ("noise", "qpos/*")),
    ],
)
def test_what_does_not_go_together_is_refused(make: Callable[[], object], message: str, path: tuple[str, ...]) -> None:
    with pytest.raises(UsageError) as caught:
        make()
    assert message in spelled(str(caught.value), str)
    assert caught.value.path == path


def test_terms_know_what_they_are() -> None:
    assert Observation(name="x", command="goal").source == "command"
    assert Reward(value="1").weight == 1
    assert Termination(when="1 > 0", as_="success").ending("there") == Ending("there", "success")
    assert not TIMED_OUT.terminated
    assert UNSTABLE.terminated
    assert Reset(vary={"geom/floor.friction": "1,0.1,0.1"}).vary == (("geom/floor.friction", "1,0.1,0.1"),)
