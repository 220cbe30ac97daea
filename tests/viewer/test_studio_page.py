"""Studio's page, served in a process of its own: on this machine, to itself, and gone when it is closed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import PATIENCE

ROOT = Path(__file__).parents[2]
# Serves a page as the simulation does, and works it in both roles: Studio installs hooks that stay in a process.
SCRIPT = r'''
import copy, socket, subprocess, sys, threading, time, urllib.error, urllib.request
import mujoco, numpy as np
from mjrun.viewer import studio_page as studio
from mjrun.viewer.actions import PullBodies, ResetSimulation, SetPaused, SetSpeed, SetStateNumbers, SimulationStatus
from mjrun.viewer.actions import PHYSICS_SETTINGS, TakeStep, UnsupportedAction
from tests.viewer.studio_client import Page, browser, payloads
from websockets.sync.client import connect
from websockets.exceptions import InvalidStatus

# Another user, where this process may become one: it reads what it gets from the socket, and asks for the page.
STRANGER = """
import os, socket, sys, urllib.error, urllib.request
"host".encode("idna")  # loads what another user may not read
if os.geteuid() == 0:
    os.setgid(65534)
    os.setuid(65534)
with socket.create_connection(("127.0.0.1", int(sys.argv[1])), 60) as connection:
    try:
        print("closed" if connection.recv(1) == b"" else "served", end=" ")
    except ConnectionResetError:
        print("closed", end=" ")
try:
    urllib.request.urlopen(f"http://127.0.0.1:{sys.argv[2]}/model")
except urllib.error.HTTPError as error:
    print(error.code)
"""

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
hooks, threads = (sys.excepthook, threading.excepthook), threading.active_count()

# Whoever comes before the first frame, as a tab that is still open does, is put off: frames wait for that here.
first_frame, prepare, early = threading.Event(), studio.LoopbackViewer.prepare_next_frame, []

def wait_and_prepare(viewer):
    assert first_frame.wait(1800)
    return prepare(viewer)

def come_early():
    end = time.monotonic() + 1800
    while len(early) < 2 and time.monotonic() < end:
        try:
            token = studio._tokens[port]
            early.append(urllib.request.urlopen(f"http://127.0.0.1:{port}/?token={token}").status)
        except urllib.error.HTTPError as error:
            early.append(error.code)
            try:
                connect(f"ws://127.0.0.1:{port}/ui?sid=early&token={token}")
            except InvalidStatus as refusal:
                early.append(refusal.response.status_code)
        except (KeyError, OSError):
            time.sleep(0.01)  # it does not listen yet
    first_frame.set()

studio.LoopbackViewer.prepare_next_frame = wait_and_prepare
visitor = threading.Thread(target=come_early)
visitor.start()
page = studio.StudioWebPage(model, data, port, 0.5)
visitor.join()
assert early == [503, 503], early

def status(**changes):
    return SimulationStatus(**{**dict(time=0.0, paused=False, speed=0.5, achieved=0.5), **changes})

actions = page.sync(status())
# A frame may have come since the page is ready: each sends the forces of the mouse, zero without a user.
assert all(isinstance(action, PullBodies) and not action.forces.any() for action in actions), actions
assert page.is_open, "it is closed"
assert not page.is_seen, "it is seen"
listening = [line.split() for line in open("/proc/self/net/tcp")][1:]
inodes = {os.readlink(f"/proc/self/fd/{fd}")[8:-1] for fd in os.listdir("/proc/self/fd")
          if os.path.exists(f"/proc/self/fd/{fd}") and os.readlink(f"/proc/self/fd/{fd}").startswith("socket")}
own = [line for line in listening if line[9] in inodes and line[3] == "0A"]
assert own and all(line[1].startswith("0100007F:") for line in own), own
assert not [line for line in open("/proc/self/net/tcp6") if line.split()[9] in inodes]

# --- who is answered ---
root = f"127.0.0.1:{port}"
good = {"Host": root, "Cookie": f"mjrun-view-{port}={page.token}"}

def answer(path="/", headers=good, host=None):
    """The status and the headers of what is answered to a request as it is sent."""
    lines = [f"GET {path} HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items()), *(host or []), "", ""]
    with socket.create_connection(("127.0.0.1", port), 60) as connection:
        connection.sendall("\r\n".join(lines).encode("latin-1"))
        head = b""
        while b"\r\n\r\n" not in head and (more := connection.recv(2**16)):
            head += more
    status, *fields = head.partition(b"\r\n\r\n")[0].decode("latin-1").split("\r\n")
    return int(status.split()[1]), dict(field.split(": ", 1) for field in fields)

paths = ["/", "/index.html", "/web_client.js", "/model", "/model?total_bytes", "/assets/ibl.ktx", "/nowhere"]
sockets = ["/ui?sid=x", "/state?sid=x", "/drop?sid=x"]
upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
           "Sec-WebSocket-Version": "13"}
wrong = [{}, {"Cookie": f"mjrun-view-{port}="}, {"Cookie": f"mjrun-view-{port}={page.token[:-1]}"},
         {"Cookie": f"mjrun-view-{port}={page.token}x"}, {"Cookie": f"other={page.token}"},
         {"Cookie": f"mjrun-view-{port}=\xe9\xff"}, {"Authorization": f"Bearer {page.token}"}]
for path in [*paths, *sockets, "/?token=", f"/?token={page.token[:-1]}", "/?token=%e9", f"/{page.token}"]:
    for headers in wrong:
        extra = upgrade if path in sockets else {}
        code, fields = answer(path, {"Host": root, **headers, **extra})
        assert code == 403 and "Set-Cookie" not in fields, (path, headers, code)
assert not page.is_seen
assert [answer(path)[0] for path in paths] == [200, 200, 200, 200, 200, 200, 404]
for path in paths[:6]:
    address = f"{path}{'&' if '?' in path else '?'}token={page.token}"
    assert answer(address, {"Host": root})[0] == 200, address
code, fields = answer(f"/?token={page.token}", {"Host": root})
assert fields["Set-Cookie"] == f"mjrun-view-{port}={page.token}; HttpOnly; SameSite=Strict; Path=/", fields
for path in [*paths, "/?token=wrong"]:
    fields = answer(path)[1]
    assert fields["X-Content-Type-Options"] == "nosniff" and fields["Referrer-Policy"] == "no-referrer"
    assert "frame-ancestors 'none'" in fields["Content-Security-Policy"] and "Access-Control-Allow-Origin" not in fields

for host, code in [
    (["Host: evil.example"], 403), (["Host: [::1"], 400), (["Host: ["], 400), (["Host: a]"], 400), ([], 400),
    ([f"Host: {root}", f"Host: {root}"], 400), (["Host: \xff"], 403), (["Host: "], 403), (["Host: a b@c:d"], 403),
    ([f"Host: {root}", "Origin: http://evil.example"], 403), ([f"Host: {root}", "Origin: null"], 403),
    ([f"Host: {root}", "Origin: http://127.0.0.1:1"], 403), ([f"Host: {root}", f"Origin: http://{root}"], 200),
    ([f"Host: localhost:9000", "Origin: http://localhost:9000"], 200), ([f"Host: [::1]:9000"], 200),
]:
    assert answer("/model", {"Cookie": good["Cookie"]}, host)[0] == code, host

for headers, origin in [({}, None), ({"Cookie": good["Cookie"]}, "http://evil.example")]:
    try:
        connect(f"ws://{root}/state?sid=evil", origin=origin, additional_headers=headers)
    except InvalidStatus as error:
        assert error.response.status_code == 403
    else:
        raise AssertionError(headers)
assert not page.is_seen

# --- what the user interface connects to, which is none of the machine's business ---
(inner,) = {int(line[1].partition(":")[2], 16) for line in own} - {port}
with socket.create_connection(("127.0.0.1", inner), 60) as ours:  # by this process, whose end the page replaces
    pass
stranger = subprocess.run([sys.executable, "-c", STRANGER, str(inner), str(port)], capture_output=True, text=True)
assert stranger.stdout == "closed 403\n", stranger

opened = Page(f"http://{root}/?token={page.token}")
assert b"<canvas" in opened.content
with browser(opened) as states:
    states.send("theme=dark")  # as a page does when it opens
    data.qpos[0] = 0.123
    for _ in range(600):
        page.sync(status())
        time.sleep(0.01)
        payload = next(payloads(states))
        if np.float64(0.123).tobytes() in payload:
            break
    else:
        raise AssertionError("the state does not come")
    assert page.is_seen

m, messages = page._messages, studio.messages
paused = studio.sim.PauseState.NORMAL_PAUSED
control = lambda **given: messages.StepControlSnapshot(**{"speed": 50.0, **given})
options = copy.deepcopy(model.opt)
options.gravity[2] = 1
forces = np.arange(6.0 * model.nbody)
for event, expected in [
    (control(pause_state=paused), SetPaused(True)),
    (control(), SetPaused(False)),
    (control(speed=25.0), SetSpeed(0.25)),
    (control(speed=25.0, noise_scale=1.0), studio.NOISE),
    (messages.SingleStepEvent(), TakeStep()),
    (messages.ResetEvent(key=-1), ResetSimulation(None)),
    (messages.ResetEvent(key=2), ResetSimulation(2)),
    (messages.LoadModelEvent(path=""), ResetSimulation(None)),
    (messages.LoadModelEvent(path="/etc/passwd"), studio.DROPPED),
    (messages.MjOptionSnapshot(opt=options), PHYSICS_SETTINGS),
    (messages.KeyframeEvent(key=0, state=np.zeros(1)), studio.KEYFRAME),
]:
    page._handle.dispatch(event)
    actions, m.actions = m.actions, []
    assert actions == [expected], (event, actions)
page._handle.dispatch(messages.MjOptionSnapshot(opt=copy.deepcopy(model.opt)))
page._handle.dispatch(messages.PerturbSnapshot(state=forces, state_sig=int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)))
(pull,) = m.actions
assert pull.forces.tolist() == forces.reshape(-1, 6).tolist()
assert not data.xfrc_applied.any() and model.opt.gravity[2] != 1

page.close()
assert not page.is_open
assert (sys.excepthook, threading.excepthook) == hooks
end = time.monotonic() + 1800
while threading.active_count() > threads and time.monotonic() < end:
    time.sleep(0.1)
assert threading.active_count() == threads, threading.enumerate()
with socket.socket() as again:
    again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    again.bind(("127.0.0.1", port))
print("closed")
'''


@pytest.mark.slow
def test_it_is_local_guarded_worked_and_closed(swing: Path, tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "HOME": str(home), "MUJOCO_GL": "disable"}
    command = [sys.executable, "-c", "import os\n" + SCRIPT, str(swing)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert (done.stdout.splitlines()[-1:], done.returncode) == (["closed"], 0), done.stderr
    assert "Traceback" not in done.stderr
    assert list(home.iterdir()) == []  # Studio would leave its settings there
