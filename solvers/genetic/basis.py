"""The functions that a method names."""

from __future__ import annotations

from solvers.bases.daubechies import DaubechiesBasis
from solvers.spec import GeneticMethod


def basis_of(method: GeneticMethod) -> DaubechiesBasis:
    """The basis with all of its levels of wavelets."""
    return DaubechiesBasis(method.order, method.scaling_functions, method.wavelet_levels, method.periodic)
