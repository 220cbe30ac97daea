"""The version is the one that the installed package has."""

from importlib.metadata import version

import mjrun
from mjrun.version import __version__


def test_the_version_is_that_of_the_installed_package() -> None:
    assert mjrun.__version__ == __version__ == version("mjrun")
