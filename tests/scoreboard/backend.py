"""What draws here, found once for all measures."""

import subprocess
import sys
from functools import cache

FIND = "from mjrun.rendering.backend import *; from mjrun.rendering.backend_detection import BackendDetection as D"


@cache
def working_backend() -> str:
    """The name of an OpenGL backend that works, `egl` as a rule; empty if there is none."""
    program = f"{FIND}; print(D('auto').result().name)"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    return found.stdout.strip() if not found.returncode else ""
