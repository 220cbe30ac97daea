"""A fixed workload that is timed alternately with the measurement.

Anything that slows down the whole machine, such as another process, a lower clock frequency or a busy host, slows down
both; the quotient of their wall times stays the same. This is duet benchmarking: Bulej, Horký, Tůma, Farquet &
Prokopec, Duet Benchmarking: Improving Measurement Accuracy in the Cloud, ICPE 2020.
"""

import mujoco

from mjrun.bench.block_timing import BatchRolloutTimer, Clock, RolloutInputs
from mjrun.bench.statistics import SampleStatistics, summarized
from mjrun.dataclass import dataclass
from mjrun.model.mujoco_globals import without_timers

VERSION = 1  # to be increased when the model or the steps change
STEPS = 100  # in a repetition
SHARE = 0.25  # of the wall time of the measurement
MOST_REPETITIONS = 10_000

# A three-legged figure that drops onto the floor: 12 degrees of freedom, several contacts, Newton's method.
MJCF = """
<mujoco model="reference workload">
  <option timestep=".002" integrator="implicitfast" solver="Newton" cone="pyramidal" jacobian="dense"
    iterations="100" tolerance="1e-8"/>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body pos="0 0 .52" euler="5 10 0">
      <freejoint/>
      <geom type="ellipsoid" size=".2 .2 .1" mass="2"/>
      <replicate count="3" euler="0 0 120">
        <body pos=".2 0 0">
          <joint axis="0 1 0" range="-60 60" damping=".5" armature=".01"/>
          <geom type="capsule" fromto="0 0 0 .2 0 -.2" size=".04" mass=".5"/>
          <body pos=".2 0 -.2">
            <joint axis="0 1 0" range="-60 60" damping=".5" armature=".01"/>
            <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".04" mass=".3"/>
          </body>
        </body>
      </replicate>
    </body>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True)
class ReferenceWorkloadInfo:
    """Facts about the workload that represents the speed of the machine.

    Attributes:
      version: version of the workload; only equal versions are compared.
      steps: steps of its model in a repetition.
    """

    version: int = VERSION
    steps: int = STEPS


class ReferenceWorkloadTimer:
    """A timer of the fixed workload, on one thread or several.

    Args:
      copies: number of copies of its model, one thread each.

    Attributes:
      samples: wall time per step of one copy [s], in chronological order.
    """

    def __init__(self, clock: Clock, copies: int = 1) -> None:
        model = mujoco.MjModel.from_xml_string(MJCF)
        self._roller = BatchRolloutTimer(RolloutInputs.of(model, mujoco.MjData(model)), copies)
        self._clock = clock
        self._repetitions = 1
        self.samples: list[float] = []

    def fit(self, seconds: float) -> None:
        """Makes each sample take about `SHARE` of `seconds`, the wall time of the measurement between two samples.

        A scheduler assigns the processor in slices of milliseconds: only work of similar length is disturbed as much.
        """
        cost = min(self._repetition() for _ in range(2))  # the first starts the threads
        self._repetitions = min(max(1, round(SHARE * seconds / cost)), MOST_REPETITIONS)

    def time(self) -> None:
        """Takes another sample."""
        spent = sum(self._repetition() for _ in range(self._repetitions))
        self.samples.append(spent / (self._repetitions * STEPS * self._roller.copies))

    @property
    def step(self) -> SampleStatistics:
        """Wall time per step of one copy [s]."""
        return summarized(self.samples)

    def _repetition(self) -> float:
        """Times one repetition of the motion [s]."""
        with without_timers():
            return float(self._roller.seconds(STEPS, STEPS, self._clock)[0])
