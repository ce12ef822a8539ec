"""What tracker and predictor say to each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class First:
    """Predict the first segment, within so many ``seconds``."""

    seconds: float


@dataclass(frozen=True)
class Follow:
    """Predict the segment after the last one, whose tracking begins at ``true_start`` (n,)."""

    seconds: float
    true_start: NDArray[np.float64]


Request = First | Follow
