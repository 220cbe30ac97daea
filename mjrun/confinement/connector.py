"""A process that connects a confined one with itself, for the user interface of a page, and with nobody else.

The filter of system calls cannot tell where `connect` leads: so the kernel asks this process instead, which was forked
before and is free. Whatever address was meant, it connects to the one port, and puts its socket in place of the
caller's: see seccomp_unotify(2) and linux/seccomp.h.
"""

import fcntl
import os
import select
import signal
import socket
import struct

RECEIVE, SEND, ADD_FILE = 0xC0502100, 0xC0182101, 0x40182103  # requests to the kernel
IN_PLACE = 1  # of the descriptor that is named
NOTICE, FIRST_ARGUMENT = 80, 32  # bytes of a notice, and before the first argument of the call in it
HOST = "127.0.0.1"


class Connector:
    """The process, which starts at once, before this one is confined.

    Attributes:
      bound: a socket at the port that it connects to.
    """

    def __init__(self) -> None:
        self.bound = socket.socket()
        self.bound.bind((HOST, 0))
        self._channel, theirs = socket.socketpair()
        if not os.fork():
            try:
                os.setsid()  # the terminal's signals are for the others
                for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                    signal.signal(number, signal.SIG_IGN)
                self._channel.close()
                _serve(theirs, self.bound.getsockname())
            finally:
                os._exit(0)
        theirs.close()

    def listen(self, listener: int) -> None:
        """Gives it the descriptor by which the kernel asks, which this process has no more then."""
        socket.send_fds(self._channel, [b"x"], [listener])
        self._channel.close()
        os.close(listener)


def _serve(channel: socket.socket, address: tuple[str, int]) -> None:
    """Answers what the kernel asks until the processes that it asks for have ended."""
    _, (listener, *_), _, _ = socket.recv_fds(channel, 1, 1)
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nothing, stream)
    poll = select.poll()
    poll.register(listener, select.POLLIN)
    while poll.poll()[0][1] & select.POLLIN:
        notice = bytearray(NOTICE)
        try:
            fcntl.ioctl(listener, RECEIVE, notice)
            (number,) = struct.unpack_from("Q", notice)
            (descriptor,) = struct.unpack_from("I", notice, FIRST_ARGUMENT)
            error = _connect(listener, number, descriptor, address)
            fcntl.ioctl(listener, SEND, struct.pack("QqiI", number, 0, -error, 0))
        except OSError:  # the caller has ended
            continue


def _connect(listener: int, number: int, descriptor: int, address: tuple[str, int]) -> int:
    """Connects the call of a number, whose socket is a descriptor; returns the number of the error, or 0."""
    with socket.socket() as made:
        try:
            place = struct.pack("QIIII", number, IN_PLACE, made.fileno(), descriptor, os.O_CLOEXEC)
            fcntl.ioctl(listener, ADD_FILE, place)  # before it is connected, so that its process is known by it
            made.connect(address)
            made.setblocking(False)
        except OSError as error:
            return error.errno or 1
    return 0
