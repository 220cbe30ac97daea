"""Theorems about what random actions bring to light in a task."""

from tests.check.tasks import HEAD, checked


def test_a_reward_that_is_not_finite_is_found_with_its_instant() -> None:
    found = checked("rewards:\n  fine: 1\n  worse: {weight: 2, value: '1/where(time > 0.1, 1, 0)'}\n")
    assert [(each.code, each.severity, each.line) for each in found] == [("MJ803", "error", 11)]
    assert found[0].message == "inf 0.02 s into the episode of seed 0"
    assert found[0].object == "reward 'worse'"
    (found_late,) = checked("rewards: {late: sqrt(0.509 - time)}")
    assert found_late.message == "nan 0.52 s into the episode of seed 0"


def test_an_observation_that_is_not_finite_is_found_once_for_its_term() -> None:
    text = HEAD.replace("actions:", "- {name: bad, value: log(qpos/rail - 1), history: 3}\nactions:")
    (finding,) = checked(head=text)
    assert (finding.code, finding.line) == ("MJ803", 7)
    assert finding.message.startswith("nan 0 s into the episode of seed 0")


def test_a_termination_at_the_start_is_an_error_if_it_always_holds() -> None:
    (always,) = checked("terminations:\n  low: {when: qpos/rail < 1, as: failure}")
    assert (always.code, always.severity, always.line) == ("MJ804", "error", 10)
    assert always.message == "'low' holds at the start of every episode, before the first action"


def test_and_a_warning_if_it_does_sometimes() -> None:
    """The share is that of the draws beyond the bound."""
    text = "reset: {noise: {qpos/rail: 'uniform(-1, 1)'}}\nterminations: {far: {when: qpos/rail > 0, as: failure}}"
    (sometimes,) = checked(text)
    assert (sometimes.code, sometimes.severity, sometimes.line) == ("MJ804", "warning", 10)
    share = int(sometimes.message.split("the start of ")[1].split(" of ")[0])
    assert 2 <= share <= 14  # of 16: outside with a probability of 5e-4


def test_actions_beyond_a_control_are_told_as_far_as_they_are_known() -> None:
    squashed = HEAD.replace("clip: [-1, 1]", "squash: tanh, scale: -3, offset: 0.5")
    (finding,) = checked(head=squashed)
    assert (finding.code, finding.severity, finding.line) == ("MJ805", "note", 8)
    assert finding.message.endswith("clamps them: push (-2.5..3.5 of -2..2)")
    assert checked(head=HEAD.replace("clip: [-1, 1]", "scale: 3")) == []  # without limits of its own
    assert checked(head=HEAD.replace("clip: [-1, 1]", "clip: [-1, 1], scale: 2")) == []


def test_an_observation_that_never_changes_is_told() -> None:
    text = HEAD.replace("- {name: speed", "- {name: still, probe: [xpos/box/x, qpos/rail]}\n- {name: speed")
    (finding,) = checked(head=text)
    assert (finding.code, finding.severity, finding.line) == ("MJ807", "note", 6)
    assert finding.message.startswith("still/xpos/box/x: the same in all 16 episodes of random actions")


def test_episodes_that_become_unstable_are_told_with_their_seeds() -> None:
    text = HEAD.replace("clip: [-1, 1]}", "scale: 9.0e+9}").replace(
        "model: slider.xml",
        "model: slider.xml\nset: {actuator/push.ctrlrange: [-1.0e+10, 1.0e+10], 'geom/*.density': 0.01}",
    )
    (finding,) = checked(head=text)
    assert (finding.code, finding.severity, finding.line) == ("MJ806", "warning", 9)
    assert finding.message.startswith("16 of 16 episodes of random actions become unstable: seeds 0, 1, 2")
