"""The rigs there are."""

from mjrun.camera.rigs.registry import RIGS


def test_rigs_are_found_by_the_names_that_documents_have_for_them() -> None:
    assert list(RIGS) == ["camera", "free", "orbit", "track", "look", "path"]
    assert all(kind == rig.kind for kind, rig in RIGS.items())
