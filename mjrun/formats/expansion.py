"""How far compressed files may expand: a small one that fills the memory is refused before it is decoded."""

from pathlib import Path

from mjrun.errors import FileError

FREE = 2**30  # bytes that any file may expand to
RATIO = 100  # bytes in memory for each byte of a larger file; deflate makes a thousand of one
HINT = "if you trust it, write it again without compression"


def largest_expansion(path: Path) -> int:
    """Returns the number of bytes that the content of a file may take in memory."""
    return max(FREE, RATIO * path.stat().st_size)


def require_expandable(path: Path, size: int) -> None:
    """Checks that a file, decoded to `size` bytes, does not fill the memory out of proportion to its own size.

    Raises:
      FileError: it does.
    """
    if size > largest_expansion(path):
        own = path.stat().st_size
        ratio = f"{size / own:,.0f} times its size" if own else "and is empty"
        raise FileError(path, f"would expand to {size / 1e9:,.1f} GB in memory, {ratio}", HINT)
