from collections.abc import Sequence
from typing import Any

import numpy as np

Values = np.ndarray[Any, np.dtype[np.float64]]

def lfilter(b: Sequence[float], a: Sequence[float], x: Values, /) -> Values: ...
