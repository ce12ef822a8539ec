"""What all methods have in common: how they refine, and how exactly their answers are verified."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from solvers.spec.base import SpecModel
from solvers.spec.fields import Choice, Count, Real

MESH_TOLERANCE = 1e-2
"""Verification tolerance of a mesh that is given, relative to each quantity's scale."""

REFINED_TOLERANCE = 1e-6
"""Verification tolerance of an answer that is refined."""

HIGHEST_LEVEL = 20
"""The highest level that wavelets may be asked for."""


class Adaptivity(SpecModel):
    """A mesh that is refined until the error is within the tolerance."""

    tolerance: Annotated[float, Real(above=0, limit=1)] = 1e-8
    """Error to be reached, relative to each quantity's scale; also the verification tolerance."""


class SplineAdaptivity(Adaptivity):
    """A set of active wavelets that follows the error."""

    tolerance: Annotated[float, Real(above=0, limit=1)] = 1e-6
    """Error to be reached, relative to each quantity's scale; also the verification tolerance."""
    max_level: Annotated[int, Count(0, HIGHEST_LEVEL, "levels")] = 10
    """Highest level of a wavelet: the finest step is that of 2^max_level L intervals."""


Refine = Annotated[Literal["switching"] | None, Choice(("switching",), (None,))]


class MethodModel(SpecModel):
    """What all methods have in common."""

    title: ClassVar[str]

    @property
    def verification_tolerance(self) -> float:
        """Verification tolerance unless a document gives one, relative to each quantity's scale."""
        adaptivity = self.adaptivity
        if adaptivity is not None:
            return adaptivity.tolerance
        return MESH_TOLERANCE if self.refinement is None else REFINED_TOLERANCE

    @property
    def adaptivity(self) -> Adaptivity | None:
        """How the mesh adapts; None for a mesh that is given."""
        found: Adaptivity | None = getattr(self, "adaptive", None)
        return found

    @property
    def refinement(self) -> str | None:
        """How the answer is refined; None for methods that do not know how."""
        word: str | None = getattr(self, "refine", None)
        return word
