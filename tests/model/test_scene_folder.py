"""Where the scenes are."""

from mjrun.model.scene_folder import scene_folder


def test_it_holds_the_scenes() -> None:
    assert (scene_folder() / "pendulum.xml").is_file()
