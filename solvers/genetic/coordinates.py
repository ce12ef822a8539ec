"""What a search moves: all genes, or those that are left where chained states end as they shall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Coordinates:
    """Genes are ``origin`` (G,) plus the coordinates times ``directions`` (C, G), which are orthonormal."""

    origin: Vector
    directions: Vector

    @property
    def size(self) -> int:
        """C, the number of coordinates."""
        return int(self.directions.shape[0])

    @classmethod
    def all(cls, genes: int) -> Coordinates:
        """Every gene moves by itself."""
        return cls(np.zeros(genes), np.eye(genes))

    @classmethod
    def on(cls, matrix: Vector, wanted: Vector) -> Coordinates:
        """The genes that meet ``matrix`` (K, G) @ genes = ``wanted`` (K,), as well as they can be met."""
        origin = np.linalg.lstsq(matrix, wanted)[0]
        return cls(np.asarray(origin, np.float64), np.asarray(linalg.null_space(matrix).T, np.float64))

    def genes(self, coordinates: Vector) -> Vector:
        """Genes (P, G) of coordinates (P, C)."""
        return self.origin + coordinates @ self.directions

    def of(self, genes: Vector) -> Vector:
        """The coordinates (C,) of the point nearest to genes (G,)."""
        return (genes - self.origin) @ self.directions.T
