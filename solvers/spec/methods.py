"""The methods: what the ``method`` object of a document may be, one class each."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import model_validator

from solvers.spec.base import SpecModel
from solvers.spec.faults import refuse
from solvers.spec.fields import Count, Real, Unsupported

MAX_NODES = 65_539
MAX_GAUSS_NODES = 8_192

Adaptive = Annotated[None, Unsupported("adaptive meshes are")]
Refine = Annotated[None, Unsupported("switching refinement is")]


class MethodModel(SpecModel):
    """What all methods have in common."""

    title: ClassVar[str]
    verification_tolerance: ClassVar[float] = 1e-2
    """Verification tolerance unless a document gives one, relative to each quantity's scale."""


class AutoMethod(MethodModel):
    """Spline wavelet collocation with its defaults."""

    title = "Automatic choice"

    name: Literal["auto"]
    """The method."""
    accuracy: Annotated[float, Real(above=0)] = 1e-6
    """Accuracy that is asked for."""


class SplineWaveletMethod(MethodModel):
    """Spline wavelet collocation on N = 2^J L + 3 points."""

    title = "Spline wavelet collocation (SWCM)"

    name: Literal["swcm"]
    """The method."""
    L: Annotated[int, Count(5, MAX_NODES, "nodes")] = 8
    """Length of the coarsest grid in intervals; greater than 4."""
    J: Annotated[int, Count(0, 16, "levels: more than 65,539 nodes")] = 4
    """Resolution level: every level doubles the number of intervals."""
    adaptive: Adaptive = None
    """Adaptive refinement; not in this version."""
    refine: Refine = None
    """Refinement of switching times; not in this version."""

    @property
    def points(self) -> int:
        """Number of points N = 2^J L + 3."""
        return (self.L << self.J) + 3

    @model_validator(mode="after")
    def _limit(self) -> Self:
        if self.points > MAX_NODES:
            detail = f"limit: 2^J*L + 3 = {self.points:,} nodes, at most {MAX_NODES:,} are allowed"
            raise refuse(detail, "J", type="limit")
        return self


class GaussPseudospectralMethod(MethodModel):
    """Gauss pseudospectral collocation at Legendre-Gauss points."""

    title = "Gauss pseudospectral method (GPM)"

    name: Literal["gpm"]
    """The method."""
    nodes: Annotated[int, Count(1, 512, "nodes a segment")] = 40
    """Legendre-Gauss points in each segment, ends not counted."""
    segments: Annotated[int, Count(1, MAX_GAUSS_NODES, "segments")] = 1
    """Number of segments."""
    adaptive: Adaptive = None
    """Adaptive refinement; not in this version."""
    refine: Refine = None
    """Refinement of switching times; not in this version."""

    @model_validator(mode="after")
    def _limit(self) -> Self:
        total = self.nodes * self.segments
        if total > MAX_GAUSS_NODES:
            detail = f"limit: nodes * segments = {total:,}, at most {MAX_GAUSS_NODES:,} are allowed"
            raise refuse(detail, "segments", type="limit")
        return self


class HermiteSimpsonMethod(MethodModel):
    """Hermite-Simpson collocation with midpoints as unknowns."""

    title = "Hermite-Simpson collocation"

    name: Literal["hermite_simpson"]
    """The method."""
    intervals: Annotated[int, Count(1, (MAX_NODES - 1) // 2, "intervals: more than 65,539 nodes")] = 60
    """Number of intervals; each brings its end and its middle as points."""
    adaptive: Adaptive = None
    """Adaptive refinement; not in this version."""
    refine: Refine = None
    """Refinement of switching times; not in this version."""


Method = AutoMethod | SplineWaveletMethod | GaussPseudospectralMethod | HermiteSimpsonMethod

METHODS: dict[str, type[Method]] = {
    "auto": AutoMethod,
    "swcm": SplineWaveletMethod,
    "gpm": GaussPseudospectralMethod,
    "hermite_simpson": HermiteSimpsonMethod,
}
"""Every method of this version by name."""
