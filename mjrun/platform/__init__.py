"""Differences between operating systems.

`system` has the functions that they provide in different ways, or do not provide: it is `posix` or `windows`, by what
exists. Only the crash monitor and the confinement use POSIX themselves; they are imported, or called, where
`system.CAN_FORK` is true.
"""

try:
    from mjrun.platform import posix as system
except ImportError:
    from mjrun.platform import windows as system

__all__ = ["system"]
