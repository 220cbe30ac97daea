"""Files that can run code as they are opened."""

from pathlib import Path

from mjrun.confinement.confinement import require_unconfined
from mjrun.errors import UsageError, clean, option
from mjrun.formats.input_file import require_file


def require_trusted_file(path: Path, trust: bool) -> None:
    """Checks that `path` is a regular file that the user trusts.

    Raises:
      FileError: there is none.
      UsageError: the user does not trust it.
    """
    require_file(path, "policy", [path.suffix.lower()])
    require_unconfined(f"{clean(str(path))} can run any code as it is opened")
    if not trust:
        raise UsageError(
            f"{clean(str(path))} can run any code as it is opened\n"
            f"{option('trust')} opens it, if you know where it comes from; a policy in ONNX needs no trust",
            ("policy",),
        )
