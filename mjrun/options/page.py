"""Options of pages about results."""

from typing import ClassVar

from mjrun.options.kinds import File, Optional
from mjrun.options.number_kinds import Real
from mjrun.options.option import Options, option, options


@options
class PageOptions(Options):
    """A self-contained page about a result, which any browser opens without network or scripts."""

    section: ClassVar[str] = "Page"

    html: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help="Page about the result (.html): plots, images, videos, descriptions of columns, assertions and manifests.",
    )
    embed_up_to: float = option(
        converter=Real(metavar="MB"),
        default=10.0,
        help="Embed images and videos up to this size in the page; larger ones are linked.",
    )
