"""Functions that operating systems provide in different ways, or do not provide.

This module selects `posix` or `windows` by what exists. Only the crash monitor and the confinement use POSIX
themselves; they are imported, or called, where `CAN_FORK` is true.
"""

try:
    import fcntl  # noqa: F401
except ImportError:
    from mjrun.platform.windows import (
        CAN_FORK,
        PASSES_DESCRIPTORS,
        READ_FLAGS,
        SIGNALS,
        duplicate,
        effective_user,
        end_after,
        hard_link,
        hold_signals,
        is_full,
        is_read_only,
        kill_group,
        locked,
        machine_name,
        make_nonblocking,
        process_options,
        reader_is_gone,
        release_signals,
        send_promise,
        set_limits,
        wait_for_hangup,
        wait_until_writable,
    )
else:
    from mjrun.platform.posix import (
        CAN_FORK,
        PASSES_DESCRIPTORS,
        READ_FLAGS,
        SIGNALS,
        duplicate,
        effective_user,
        end_after,
        hard_link,
        hold_signals,
        is_full,
        is_read_only,
        kill_group,
        locked,
        machine_name,
        make_nonblocking,
        process_options,
        reader_is_gone,
        release_signals,
        send_promise,
        set_limits,
        wait_for_hangup,
        wait_until_writable,
    )

__all__ = [
    "CAN_FORK",
    "PASSES_DESCRIPTORS",
    "READ_FLAGS",
    "SIGNALS",
    "duplicate",
    "effective_user",
    "end_after",
    "hard_link",
    "hold_signals",
    "is_full",
    "is_read_only",
    "kill_group",
    "locked",
    "machine_name",
    "make_nonblocking",
    "process_options",
    "reader_is_gone",
    "release_signals",
    "send_promise",
    "set_limits",
    "wait_for_hangup",
    "wait_until_writable",
]
