"""What only the command line says of a run: who drives it, and what draws it here."""

from dataclasses import dataclass
from fractions import Fraction

from mjrun.sim.controller import Controller


@dataclass(frozen=True)
class Machine:
    """What no document says.

    Args:
      controller: code that sets the controls, called every `control_dt` [s]; every step when None.
      gl: OpenGL backend; `auto` tries all.
      require_gpu: refuse to draw in software.
      quality: of all films and stills, instead of their own.
      jobs: processes that draw each film, instead of its own number.
      command: the command line, for manifests.
    """

    controller: Controller | None = None
    control_dt: Fraction | None = None
    gl: str | None = None
    require_gpu: bool = False
    quality: str | None = None
    jobs: int | str | None = None
    command: str = ""


ANY = Machine()
