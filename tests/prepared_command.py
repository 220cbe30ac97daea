"""The program `mjrun` of shells in tests: it starts a copy of a prepared interpreter, and waits for its end.

python -I -S prepared_command.py SOCKET ARGUMENT...

The copy has the streams, the folder and the environment of this process, and gets its signals.
"""

import json
import os
import signal
import socket
import sys

path, *arguments = sys.argv[1:]
request = {"args": [sys.executable, "-m", "mjrun", *arguments], "env": dict(os.environ), "pass_fds": []}
with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as server:
    server.connect(path)
    socket.send_fds(server, [json.dumps(request).encode()], [os.open(".", os.O_PATH), 0, 1, 2])
    copy = int(server.recv(16))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: os.kill(copy, number))
    code = int(server.recv(16))
sys.exit(code if code >= 0 else 128 - code)
