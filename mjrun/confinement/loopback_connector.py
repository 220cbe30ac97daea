"""A process that connects a confined one to itself, for the user interface of a page, and to no other address.

The filter of system calls cannot see the address of a `connect`; the kernel asks this process instead, which was forked
earlier and is not confined. It connects to the single port, whatever address was requested, and replaces the caller's
socket with its own: see seccomp_unotify(2) and linux/seccomp.h.
"""

import fcntl
import os
import select
import signal
import socket
import struct

RECEIVE, SEND, ADD_FILE = 0xC0502100, 0xC0182101, 0x40182103  # requests to the kernel
IN_PLACE = 1  # flag: replaces the named descriptor
NOTICE, FIRST_ARGUMENT = 80, 32  # the size of a notice, and the offset of the first argument in it [bytes]
HOST = "127.0.0.1"


class LoopbackConnector:
    """A process that makes connections for this one; it is started before this one is confined.

    Attributes:
      bound: a socket at the port to which it connects.
    """

    def __init__(self) -> None:
        self.bound = socket.socket()
        self.bound.bind((HOST, 0))
        self._channel, theirs = socket.socketpair()
        if not os.fork():
            try:
                os.setsid()  # signals of the terminal do not reach it
                for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                    signal.signal(number, signal.SIG_IGN)
                self._channel.close()
                _serve(theirs, self.bound.getsockname())
            finally:
                os._exit(0)
        theirs.close()

    def listen(self, listener: int) -> None:
        """Passes it the descriptor by which the kernel asks, and closes that here."""
        socket.send_fds(self._channel, [b"x"], [listener])
        self._channel.close()
        os.close(listener)


def _serve(channel: socket.socket, address: tuple[str, int]) -> None:
    """Answers the kernel's requests until the processes that it asks for have ended."""
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
    """Connects the socket `descriptor` of a call, given by its number; returns the number of the error, or 0."""
    with socket.socket() as made:
        try:
            place = struct.pack("QIIII", number, IN_PLACE, made.fileno(), descriptor, os.O_CLOEXEC)
            fcntl.ioctl(listener, ADD_FILE, place)  # before connecting, so that its process is known by it
            made.connect(address)
            made.setblocking(False)
        except OSError as error:
            return error.errno or 1
    return 0
