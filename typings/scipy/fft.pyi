from typing import Any

import numpy as np
from numpy.typing import ArrayLike

Values = np.ndarray[Any, np.dtype[np.float64]]

def dct(x: ArrayLike, *, norm: str | None = None) -> Values: ...
