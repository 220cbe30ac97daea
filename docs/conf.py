"""Settings of Sphinx for the site; scripts/make_docs.py writes the pages that it builds."""

from mjrun.cli.main import COMMANDS
from mjrun.version import __version__

project = "mjrun"
author = "the mjrun developers"
copyright = f"2026, {author}"  # noqa: A001 - Sphinx's name
release = __version__

extensions = ["myst_parser", "sphinx_copybutton", "sphinx_design"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

html_theme = "furo"
html_title = "mjrun"
html_static_path = ["_static"]
html_copy_source = False
html_show_sourcelink = False
html_css_files = ["site.css"]
html_theme_options = {"top_of_page_buttons": []}

# A manual page of each command: its page of the site.
man_pages = [
    ("reference/index", "mjrun", "MuJoCo models to videos, images, tables and timing reports", "", 1),
    *((f"reference/commands/{name}", f"mjrun-{name}", text.rstrip("."), "", 1) for name, text in COMMANDS.items()),
]
