"""What made two results."""

from mjrun.diff.provenance import provenance_notes

MANIFEST = {"mjrun": "1", "mujoco": "4.0.0", "seed": 0, "model": {"path": "a.xml", "sha256": "aa"}, "command": "x"}


def test_what_differs_in_what_made_them_is_reported() -> None:
    other = {**MANIFEST, "mujoco": "4.0.1\x1b", "seed": 1, "model": {"sha256": "bb"}, "command": "y"}
    assert provenance_notes(MANIFEST, other) == [
        r"MuJoCo is 4.0.0 and 4.0.1\x1b",
        "the seed is 0 and 1",
        "the models, or their overrides, differ",
    ]
    same = provenance_notes({**MANIFEST, "physics": "p"}, {**other, "physics": "p"})
    assert same[-1] == "the models, or their overrides, differ; their physics is the same"


def test_the_model_that_differs_is_named_and_so_are_the_options_that_change_it() -> None:
    def made(path: str, sha256: str, **simulation: object) -> dict[str, object]:
        return {"model": {"path": path, "sha256": sha256}, "options": {"simulation": simulation}}

    assert provenance_notes(made("a.xml", "1"), made("b.xml", "2")) == ["the models a.xml and b.xml differ"]
    assert provenance_notes(made("a.xml", "1"), made("a.xml", "2")) == [
        "the model a.xml, or a file that it refers to, has changed"
    ]
    changed = provenance_notes(made("a.xml", "1", key=None, seed=0), made("a.xml", "2", key="home", seed=1))
    assert changed == [
        "the models, or their overrides, differ",
        "the option key is None and home",
    ]


def test_nothing_is_reported_of_what_is_not_known() -> None:
    assert provenance_notes(MANIFEST, MANIFEST) == []
    assert provenance_notes(MANIFEST, None) == provenance_notes({}, MANIFEST) == []
    assert provenance_notes({"model": 1, "mujoco": None}, {"model": "b", "mujoco": [1]}) == ["MuJoCo is None and [1]"]
