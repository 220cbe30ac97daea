"""Task documents, and what checking them finds."""

from pathlib import Path

from mjrun.check.finding import Finding
from mjrun.check.rule_runner import RULES
from mjrun.check.task_checker import TaskChecker
from mjrun.check.worker_pool import CheckRequest
from mjrun.document.task import read_task
from tests.processes import memory_limit_restored

READER = f"{read_task.__module__}:{read_task.__name__}"
SLIDER = """<mujoco model="slider"><option timestep=".01"/><worldbody><body name="box"><joint name="rail" type="slide"/>
<geom size=".1"/></body></worldbody><actuator><motor name="push" joint="rail" ctrlrange="-2 2"/></actuator></mujoco>"""
HEAD = """model: slider.xml
control_dt: 0.02
duration: 1
observations:
- {name: place, probe: qpos/rail}
- {name: speed, probe: qvel/rail}
actions:
- {actuators: push, clip: [-1, 1]}
"""


def checked(text: str = "", *, head: str = HEAD, policy: str = "", steps: int = 200) -> list[Finding]:
    """What checking a document finds, in this process."""
    Path("slider.xml").write_text(SLIDER)
    Path("t.yaml").write_text(head + text)
    messages: list[dict] = []
    task = CheckRequest("t.yaml", sorted(RULES), steps, 60, 99999, READER, policy)
    with memory_limit_restored():
        TaskChecker(task, messages.append).run()
    assert messages[-1] == {"done": True}
    return [Finding(**message["finding"]) for message in messages if "finding" in message]
