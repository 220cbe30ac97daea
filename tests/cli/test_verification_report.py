"""The sentences about a verified recording."""

from mjrun.cli.verification_report import lines
from mjrun.simulation.verification import FieldDifference, VerificationResult

SAME = VerificationResult("r.npz", True, 1001, 1000, 2.0, [], [])


def test_the_same_again_is_one_line_that_says_how_much_was_compared() -> None:
    assert list(lines(SAME)) == ["r.npz: stepped again, and the same: 1000 steps, bit for bit"]
    some = VerificationResult("r\n.npz", True, 11, 1000, 2.0, [], ["MuJoCo: other"])
    assert list(lines(some)) == [
        r"r\n.npz: stepped again, and the same: 1000 steps, bit for bit at its 11 states",
        "  MuJoCo: other",
    ]


def test_a_difference_has_its_step_its_places_and_what_is_not_as_it_was() -> None:
    differences = [
        FieldDifference("qpos", "qpos/knee", 1.0, 1.25, 1),
        FieldDifference("qvel", "qvel/root/vz", 0.0, -0.0, 6),
        FieldDifference("act", "act/a\x1b", 2.0, None, 1),
    ]
    result = VerificationResult("r.npz", False, 3, 2, 0.004, differences, ["the physics differs"])
    assert list(lines(result)) == [
        "r.npz: stepped again, and not the same: the first difference is at step 2, time 0.004 s",
        "  qpos/knee: recorded 1.0, stepped 1.25, 0.25 apart",
        "  qvel/root/vz: recorded 0.0, stepped -0.0, 0 apart (and 5 more of qvel)",
        r"  act/a\x1b: recorded 2.0, stepped to what is not finite",
        "  the physics differs",
    ]
