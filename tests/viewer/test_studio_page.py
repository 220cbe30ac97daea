"""Studio's page, served in a process of its own: on this machine, to itself, and gone when it is closed."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
# Serves a page as the simulation does, and works it in both roles: Studio installs hooks that stay in a process.
SCRIPT = """
import copy, socket, sys, threading, time, urllib.error, urllib.request
import mujoco, numpy as np
from mjrun.viewer import studio_page as studio
from mjrun.viewer.window import Edit, Pull, Refuse, Reset, SetPaused, SetSpeed, Status, TakeStep
from tests.viewer.studio_client import browser, payloads, wait_for_page
from websockets.sync.client import connect
from websockets.exceptions import InvalidStatus

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
hooks, threads = (sys.excepthook, threading.excepthook), threading.active_count()

# Whoever comes before the first frame, as a tab that is still open does, is put off: frames wait for that here.
first_frame, prepare, early = threading.Event(), studio.LocalViewer.prepare_next_frame, []

def wait_and_prepare(viewer):
    assert first_frame.wait(60)
    return prepare(viewer)

def come_early():
    end = time.monotonic() + 60
    while len(early) < 2 and time.monotonic() < end:
        try:
            early.append(urllib.request.urlopen(f"http://127.0.0.1:{port}/").status)
        except urllib.error.HTTPError as error:
            early.append(error.code)
            try:
                connect(f"ws://127.0.0.1:{port}/ui?sid=early")
            except InvalidStatus as refusal:
                early.append(refusal.response.status_code)
        except OSError:
            time.sleep(0.01)  # it does not listen yet
    first_frame.set()

studio.LocalViewer.prepare_next_frame = wait_and_prepare
visitor = threading.Thread(target=come_early)
visitor.start()
page = studio.StudioPage(model, data, port, 0.5)
visitor.join()
assert early == [503, 503], early

def status(**changes):
    return Status(**{**dict(time=0.0, paused=False, speed=0.5, achieved=0.5), **changes})

assert page.sync(status()) == [] and page.is_open and not page.is_seen
listening = [line.split() for line in open("/proc/self/net/tcp")][1:]
inodes = {os.readlink(f"/proc/self/fd/{fd}")[8:-1] for fd in os.listdir("/proc/self/fd")
          if os.path.exists(f"/proc/self/fd/{fd}") and os.readlink(f"/proc/self/fd/{fd}").startswith("socket")}
own = [line for line in listening if line[9] in inodes and line[3] == "0A"]
assert own and all(line[1].startswith("0100007F:") for line in own), own
assert not [line for line in open("/proc/self/net/tcp6") if line.split()[9] in inodes]

assert b"<canvas" in wait_for_page(port, lambda: True)
for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example"}):
    try:
        urllib.request.urlopen(urllib.request.Request(f"http://127.0.0.1:{port}/model", headers=headers))
    except urllib.error.HTTPError as error:
        assert error.code == 403
    else:
        raise AssertionError(headers)
try:
    connect(f"ws://127.0.0.1:{port}/state?sid=evil", origin="http://evil.example")
except InvalidStatus as error:
    assert error.response.status_code == 403
assert not page.is_seen

with browser(port) as states:
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
    (messages.ResetEvent(key=-1), Reset(None)),
    (messages.ResetEvent(key=2), Reset(2)),
    (messages.LoadModelEvent(path=""), Reset(None)),
    (messages.LoadModelEvent(path="/etc/passwd"), studio.DROPPED),
    (messages.MjOptionSnapshot(opt=options), studio.PHYSICS_SETTINGS),
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
end = time.monotonic() + 30
while threading.active_count() > threads and time.monotonic() < end:
    time.sleep(0.1)
assert threading.active_count() == threads, threading.enumerate()
with socket.socket() as again:
    again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    again.bind(("127.0.0.1", port))
print("closed")
"""


def test_it_is_local_guarded_worked_and_closed(swing: Path, tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "HOME": str(home), "MUJOCO_GL": "disable"}
    command = [sys.executable, "-c", "import os\n" + SCRIPT, str(swing)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
    assert (done.stdout.splitlines()[-1:], done.returncode) == (["closed"], 0), done.stderr
    assert list(home.iterdir()) == []  # Studio would leave its settings there


REQUESTS = [
    ({"Host": "127.0.0.1:8080"}, True),
    ({"Host": "localhost:9000", "Origin": "http://localhost:9000"}, True),  # the end of a tunnel
    ({"Host": "[::1]:8080"}, True),
    ({"Host": "127.0.0.1:8080", "Origin": "https://example.com"}, False),
    ({"Host": "127.0.0.1:8080", "Origin": "http://127.0.0.1:9999"}, False),
    ({"Host": "127.0.0.1:8080", "Origin": "null"}, False),
    ({"Host": "rebound.example:8080", "Origin": "http://rebound.example:8080"}, False),
    ({}, False),
]


def test_requests_of_other_sites_are_told_apart() -> None:
    code = (
        "from mjrun.viewer.studio_page import _is_own_page\n"
        f"for headers, own in {REQUESTS!r}: assert _is_own_page(headers) == own, headers"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, "PYTHONPATH": str(ROOT)})
