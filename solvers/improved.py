"""An answer and how it was reached: on an adapted mesh, with a refined structure, or as it was first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic

from solvers.refine.adaptive import Adapted
from solvers.refine.arcs import Refined
from solvers.refine.residual import mesh_error_estimate
from solvers.refine.switching import Refinement
from solvers.solved import Ended
from solvers.spec import Adaptivity
from solvers.switching import find_switching
from solvers.verification.verdict import Check, Verification

# The estimated error of a mesh is within this factor of the true one: beyond it the tolerance is missed.
_CERTAINLY_OFF = 10.0


@dataclass(frozen=True)
class Improved(Generic[Ended]):
    """An answer and how it was reached: on an adapted mesh, with a refined structure, or as it was.

    ``advice``: what to do where an adapted mesh does not reach its tolerance.
    """

    solved: Ended
    adapted: Adapted[Ended] | None = None
    adaptivity: Adaptivity | None = None
    refinement: Refinement[Ended] | None = None
    advice: str = ""

    @property
    def refined(self) -> Refined[Ended] | None:
        """The refined structure that the answer has; None if it has none."""
        return None if self.refinement is None else self.refinement.refined

    @property
    def summary(self) -> Mapping[str, Any]:
        """What was done, for the ``method`` of the result."""
        done: dict[str, Any] = {}
        if self.adapted is not None and self.adaptivity is not None:
            meshes = [dict(mesh.summary) for mesh in self.adapted.meshes]
            found = meshes[0] if len(meshes) == 1 else {"phases": meshes}
            done["adaptive"] = {**self.adaptivity.model_dump(), **found}
        if self.refinement is not None:
            done |= self.refinement.summary
        return done

    @property
    def warnings(self) -> Sequence[Mapping[str, str]]:
        """Why something that was asked for was not reached."""
        if self.refined is not None:
            return []
        found = [] if self.refinement is None else self.refinement.warnings
        reason = None if self.adapted is None else self.adapted.reason
        if reason is not None:
            found = [
                *found,
                {
                    "code": "tolerance_not_reached",
                    "pointer": "/method/adaptive",
                    "detail": reason + self.advice,
                },
            ]
        return found

    @property
    def mesh_errors(self) -> list[float | None]:
        """The largest relative error of a state on an arc, by part; a refined answer was judged by it."""
        if self.refined is not None:
            return [part.error for part in self.refined.parts]
        return [
            mesh_error_estimate(part.transcription.problem, part.trajectory) for part in self.solved.parts
        ]

    @property
    def switching(self) -> list[dict[str, Any]]:
        """The ``switching`` of the result, by part."""
        if self.refined is not None:
            parts = self.refined.parts
            return [part.structure.switching(part.problem, part.solved.trajectory) for part in parts]
        return [find_switching(part.transcription.problem, part.trajectory) for part in self.solved.parts]

    def certified(self, verification: Verification) -> Verification:
        """The verification with what else a refined answer, or one on an adapted mesh, must show."""
        if self.refinement is not None:
            verification = self.refinement.certified(verification)
        if self.refined is not None or self.adapted is None or self.adaptivity is None:
            return verification
        check = Check("mesh_error", self.adapted.error, _CERTAINLY_OFF * self.adaptivity.tolerance)
        return replace(verification, checks=(*verification.checks, check))
