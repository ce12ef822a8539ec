"""The genetic algorithm: what its ``method`` object may be."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import model_validator

from solvers.bases.daubechies import INTERVAL_ORDERS, ORDERS
from solvers.spec.faults import refuse
from solvers.spec.fields import Choice, Count, Real
from solvers.spec.method_model import MESH_TOLERANCE, REFINED_TOLERANCE, MethodModel

MAX_FUNCTIONS = 4_096
MAX_EVALUATIONS = 100_000_000

SEARCHED_TOLERANCE = 5e-2
"""Verification tolerance of an answer whose end conditions are penalised, not met."""


class GeneticMethod(MethodModel):
    """A genetic algorithm on coefficients of Daubechies' functions, one gene each, polished by gradients."""

    title = "Genetic algorithm on wavelets"

    name: Literal["ga"]
    """The method."""
    wavelet: Annotated[str, Choice(tuple(f"db{order}" for order in ORDERS))] = "db2"
    """Daubechies' wavelet by the number of its vanishing moments."""
    boundary: Annotated[Literal["periodic", "interval"], Choice(("periodic", "interval"))] = "periodic"
    """Functions wrapped around the ends of time, or cut off there and made orthonormal."""
    scaling_functions: Annotated[int, Count(1, MAX_FUNCTIONS, "functions")] = 5
    """Scaling functions for each control."""
    wavelet_levels: Annotated[int, Count(0, 12, "levels")] = 0
    """Levels of wavelets, superimposed one after the other; each doubles the number of functions."""
    population: Annotated[int, Count(2, 10_000, "individuals")] = 48
    """Individuals of a generation."""
    generations: Annotated[int, Count(1, MAX_EVALUATIONS, "generations")] = 2000
    """Generations of the scaling functions, at most."""
    refine_generations: Annotated[int, Count(0, MAX_EVALUATIONS, "generations")] = 200
    """Generations of each level of wavelets, besides those that were left."""
    crossover_probability: Annotated[float, Real(least=0, limit=1)] = 0.9
    """Chance that a pair of parents exchanges genes (classic)."""
    mutation_probability: Annotated[float, Real(least=0, limit=1)] = 0.1
    """Chance of a gene to be moved (classic)."""
    mutation_sigma: Annotated[float, Real(least=0)] = 1.0
    """Standard deviation of such a move, in genes (classic)."""
    elite: Annotated[int, Count(0, 10_000, "individuals")] = 1
    """Individuals that survive unchanged (classic)."""
    penalty: Annotated[float, Real(least=0)] = 100.0
    """What the square of the end error costs, lambda; also those of bounds and path constraints."""
    seed: Annotated[int, Count(0, 2**32 - 1, "as a seed")] = 0
    """Where random numbers start: the same seed gives the same answer on the same machine."""
    processes: Annotated[int, Count(1, 64, "processes")] = 1
    """Independent runs side by side, each in a process inside of the job; the answer is the same."""
    variant: Annotated[Literal["modern", "classic"], Choice(("modern", "classic"))] = "modern"
    """Covariance matrix adaptation with restarts, or the operators of the paper."""
    polish: Annotated[Literal["exact", "penalty", False], Choice(("exact", "penalty"), (False,))] = "exact"
    """Gradients at last, in the same basis: with exact end conditions, with the penalty, or not at all."""
    refine: Annotated[Literal["collocation"] | None, Choice(("collocation",), (None,))] = None
    """Whether to hand the answer over to collocation, which knows no basis."""

    @property
    def verification_tolerance(self) -> float:
        """That of a mesh; wider where the end is only penalised."""
        if self.refine is not None:
            return REFINED_TOLERANCE
        return SEARCHED_TOLERANCE if self.ends_are_soft else MESH_TOLERANCE

    @property
    def order(self) -> int:
        """The number of vanishing moments of the wavelet."""
        return int(self.wavelet.removeprefix("db"))

    @property
    def periodic(self) -> bool:
        """Whether the functions are wrapped around."""
        return self.boundary == "periodic"

    @property
    def functions(self) -> int:
        """The number of functions for each control."""
        units = self.scaling_functions - (0 if self.periodic else 2 * self.order - 2)
        return self.scaling_functions + units * ((1 << self.wavelet_levels) - 1)

    def budget(self, starts: int = 1) -> int:
        """All generations, where so many runs may start from the guess."""
        return starts * self.generations + self.wavelet_levels * self.refine_generations

    def excess(self, starts: int = 1) -> str:
        """What is wrong with so many evaluations; nothing where they are allowed."""
        evaluations = self.population * self.budget(starts)
        if evaluations <= MAX_EVALUATIONS:
            return ""
        return f"limit: {evaluations:,} evaluations, at most {MAX_EVALUATIONS:,} are allowed"

    @property
    def goes_on(self) -> bool:
        """Whether something follows the search."""
        return self.polish is not False or self.refine is not None

    @property
    def ends_are_soft(self) -> bool:
        """Whether end conditions are only penalised in the answer."""
        return self.polish != "exact" and self.refine is None

    @property
    def eliminates(self) -> bool:
        """Whether end conditions that are linear in the genes are met exactly from the beginning.

        Not where the penalised objective is what is wanted, nor by the paper's operators.
        """
        return self.variant == "modern" and self.polish == "exact"

    @model_validator(mode="after")
    def _limits(self) -> Self:
        least = 2 * self.order - 1
        if not self.periodic and self.order not in INTERVAL_ORDERS:
            detail = f"on the interval there are db2 to db{INTERVAL_ORDERS[-1]}, not {self.wavelet}"
            raise refuse(detail, "wavelet")
        if not self.periodic and self.scaling_functions < least:
            detail = f"on the interval at least {least} for {self.wavelet}, not {self.scaling_functions}"
            raise refuse(detail, "scaling_functions")
        if self.functions > MAX_FUNCTIONS:
            detail = f"limit: {self.functions:,} functions a control, at most {MAX_FUNCTIONS:,} are allowed"
            raise refuse(detail, "wavelet_levels", type="limit")
        if self.elite > self.population:
            detail = f"at most the population of {self.population}, not {self.elite}"
            raise refuse(detail, "elite")
        if detail := self.excess():
            raise refuse(detail, "generations", type="limit")
        return self
