"""The methods: what the ``method`` object of a document may be, one class each."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from solvers.spec.faults import refuse
from solvers.spec.fields import Choice, Count, Real
from solvers.spec.genetic import GeneticMethod
from solvers.spec.method_model import Adaptivity, MethodModel, Refine, SplineAdaptivity
from solvers.spec.piecewise import (
    MAX_SEGMENT_NODES,
    MAX_SEGMENTS,
    CountOrEnd,
    Plant,
    PlantCheck,
    QuantityTable,
    Segments,
    Stop,
    Tracking,
)
from solvers.spec.values import Value

MAX_NODES = 65_539
MAX_GAUSS_NODES = 8_192


class AutoMethod(MethodModel):
    """Spline wavelets, then the exact structure of the answer, or an adapted mesh where none is found."""

    title = "Automatic choice"

    name: Literal["auto"]
    """The method."""
    accuracy: Annotated[float, Real(above=0, limit=1)] = 1e-6
    """Accuracy that is asked for, relative to each quantity's scale; also the verification tolerance."""

    @property
    def verification_tolerance(self) -> float:
        """The accuracy."""
        return self.accuracy


class SplineWaveletMethod(MethodModel):
    """Spline wavelet collocation on N = 2^J L + 3 points, or on graded knots that start from these."""

    title = "Spline wavelet collocation (SWCM)"

    name: Literal["swcm"]
    """The method."""
    L: Annotated[int, Count(5, MAX_NODES, "nodes")] = 8
    """Length of the coarsest grid in intervals; greater than 4."""
    J: Annotated[int, Count(0, 16, "levels (65,539 nodes)")] = 4
    """Resolution level: every level doubles the number of intervals."""
    adaptive: SplineAdaptivity | None = None
    """How the mesh is refined, from level J (at most max_level) on; null keeps it."""
    refine: Refine = None
    """Whether to refine the answer to its true arcs, with the switching times as unknowns."""

    @property
    def first_level(self) -> int:
        """The level of the mesh that is solved first: J, or less where it may not be so fine."""
        return self.J if self.adaptive is None else min(self.J, self.adaptive.max_level)

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
    adaptive: Adaptivity | None = None
    """How segments and nodes are refined; null keeps them."""
    refine: Refine = None
    """Whether to refine the answer to its true arcs, with the switching times as unknowns."""

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
    intervals: Annotated[int, Count(1, (MAX_NODES - 1) // 2, "intervals (65,539 nodes)")] = 60
    """Number of intervals; each brings its end and its middle as points."""
    adaptive: Adaptivity | None = None
    """How intervals are refined; null keeps them."""
    refine: Refine = None
    """Whether to refine the answer to its true arcs, with the switching times as unknowns."""


class PiecewiseMethod(MethodModel):
    """Predict the next segment on the problem's model while this one is tracked on the plant."""

    title = "Piecewise parallel optimal control"

    name: Literal["piecewise"]
    """The method."""
    segments: Segments
    """How the way is cut into segments."""
    nodes: Annotated[int, Count(1, MAX_SEGMENT_NODES, "nodes a segment")] = 20
    """Number of Hermite-Simpson intervals of a segment."""
    scheme: Annotated[Literal["lookahead", "chapter"], Choice(("lookahead", "chapter"))] = "lookahead"
    """``lookahead``: predictions see further segments and start from the simulated tracker; ``chapter``: they
    see one segment and start from the predicted end plus half the last error."""
    lookahead: Annotated[int | Literal["end"], CountOrEnd(Count(1, MAX_SEGMENTS, "segments"))] = 2
    """Number of segments that a prediction sees, its own among them, or all to the ``end``."""
    stop: Stop | None = None
    """What ends the mission; null flies to the final time."""
    tracking: Tracking = Tracking()
    """How the reference is tracked."""
    margins: Annotated[dict[str, Value], QuantityTable("state")] = Field(default_factory=dict)
    """State -> how far predictions stay inside its bounds."""
    smoothing: Annotated[float, Real(above=0, limit=1)] = 1e-5
    """Weight of squared steps of the controls, relative to the objective: decides where that says nothing."""
    plant: Annotated[Plant | None, PlantCheck()] = None
    """What is flown; null flies the problem's own model."""


Method = (
    AutoMethod
    | SplineWaveletMethod
    | GaussPseudospectralMethod
    | HermiteSimpsonMethod
    | GeneticMethod
    | PiecewiseMethod
)

METHODS: dict[str, type[Method]] = {
    "auto": AutoMethod,
    "swcm": SplineWaveletMethod,
    "gpm": GaussPseudospectralMethod,
    "hermite_simpson": HermiteSimpsonMethod,
    "ga": GeneticMethod,
    "piecewise": PiecewiseMethod,
}
"""Every method of this version by name."""
