"""Options of datasets of episodes."""

from importlib import import_module

from mjrun.options.episode_dataset import EXTRAS


def test_every_format_has_its_extra_and_the_functions_of_a_format() -> None:
    for name in EXTRAS:
        module = import_module(f"mjrun.formats.episodes.{name}")
        assert callable(module.check)
        assert callable(module.write)
