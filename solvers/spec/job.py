"""The job document itself: problem, method, options, output."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from solvers.spec.base import SpecModel
from solvers.spec.command import CommandSpec
from solvers.spec.faults import Flaws, kind_of, refuse
from solvers.spec.fields import Check, Count, Flag, FreeObject, Real, Text
from solvers.spec.genetic import GeneticMethod
from solvers.spec.method_model import MESH_TOLERANCE
from solvers.spec.methods import AutoMethod, Method
from solvers.spec.problem import ProblemSpec
from solvers.spec.resolution import Resolution, resolve
from solvers.spec.scope import Scope
from solvers.spec.tables import list_of
from solvers.spec.webhook import Webhook

MAX_TAGS = 20
MAX_TAG = 64
_MONTH = 30 * 86_400

Tolerance = Annotated[float, Real(above=0)] | None


class SchemaVersion(Check):
    """The version of the document's shape."""

    def check(self, value: Any, scope: Scope) -> int:
        """Return 1."""
        if type(value) is not int or value != 1:
            raise refuse("must be 1: this service reads documents of schema 1")
        return 1

    def schema(self) -> dict[str, Any]:
        """The number 1."""
        return {"type": "integer", "const": 1}


class Priority(Check):
    """Urgency of a job."""

    def check(self, value: Any, scope: Scope) -> str:
        """Return the priority."""
        if value in ("low", "normal", "high"):
            return str(value)
        raise refuse("must be 'low', 'normal' or 'high'")

    def schema(self) -> dict[str, Any]:
        """One of three words."""
        return {"type": "string", "enum": ["low", "normal", "high"]}


class TagList(Check):
    """At most 20 tags of at most 64 characters."""

    def check(self, value: Any, scope: Scope) -> list[str]:
        """Return the tags."""
        tags, flaws = list_of(value), Flaws()
        if len(tags) > MAX_TAGS:
            flaws.add(f"limit: at most {MAX_TAGS} tags, not {len(tags):,}", type="limit")
        for i, tag in enumerate(tags[:MAX_TAGS]):
            if not isinstance(tag, str):
                flaws.add(f"a tag must be text, not {kind_of(tag)}", i)
            elif len(tag) > MAX_TAG:
                flaws.add(f"limit: a tag has at most {MAX_TAG} characters", i, type="limit")
        flaws.raise_any()
        return tags

    def schema(self) -> dict[str, Any]:
        """A list of text."""
        return {"type": "array", "items": {"type": "string", "maxLength": MAX_TAG}, "maxItems": MAX_TAGS}


class Verification(SpecModel):
    """Tolerances of the verification, relative to each quantity's scale; null is the method's own."""

    terminal_error: Tolerance = None
    """Miss of the final state after the whole flight."""
    state_error: Tolerance = None
    """Largest difference between promised and re-integrated states."""
    bound: Tolerance = None
    """Violation of bounds."""
    path: Tolerance = None
    """Violation of path constraints."""


class Options(SpecModel):
    """How the nonlinear program is solved and its answer verified."""

    tolerance: Annotated[float, Real(above=0)] = 1e-8
    """Convergence tolerance of the nonlinear program."""
    max_iterations: Annotated[int, Count(0, 2_147_483_647, "iterations")] = 3000
    """Largest number of iterations."""
    max_seconds: Annotated[float, Real(above=0, limit=3600, unit=" s")] = 60.0
    """Longest solve time, s."""
    starts: Annotated[int, Count(1, 64, "starts")] = 1
    """Number of starting points; the best answer is kept."""
    verification: Verification = Verification()
    """Tolerances of the verification."""


class Output(SpecModel):
    """What the result holds."""

    samples: Annotated[int, Count(2, 20_001, "samples")] = 201
    """Number of equidistant samples of the trajectory."""
    command: CommandSpec | None = None
    """Table for an on-board computer, flown as it is."""
    coast: Annotated[float, Real(above=0, limit=1e6, unit=" s")] | None = None
    """Seconds to fly on at zero control, for the vibration that is left."""


class JobSpec(SpecModel):
    """A checked job document; made by `solvers.spec.check_document`."""

    schema_uri: Any = Field(None, alias="$schema")
    """Ignored."""
    schema_version: Annotated[int, SchemaVersion()] = Field(1, alias="schema")
    """Version of the document's shape."""
    name: Annotated[str, Text(200)] = ""
    """A name for people."""
    notes: Annotated[str, Text()] = ""
    """Remarks for people."""
    tags: Annotated[list[str], TagList()] = Field(default_factory=list)
    """Words to find the job by."""
    metadata: Annotated[dict[str, Any], FreeObject()] = Field(default_factory=dict)
    """Anything; handed back as it is."""
    problem: ProblemSpec
    """The optimal-control problem."""
    method: Method = Field(AutoMethod(name="auto"), discriminator="name")
    """How it is solved."""
    options: Options = Options()
    """Tolerances and limits."""
    output: Output = Output()
    """What the result holds."""
    priority: Annotated[Literal["low", "normal", "high"], Priority()] = "normal"
    """Urgency: which of the jobs that wait is started first."""
    reference: Annotated[dict[str, Any], FreeObject()] | None = None
    """The known answer of a case; ignored."""
    warm_start: Annotated[str, Text(64)] | None = None
    """Id of an earlier job to start from, of any method, mesh, parameters and phases."""
    reuse: Annotated[bool | None, Flag()] = None
    """Whether the certified result of an earlier job with the same problem, method and options will do."""
    deadline_seconds: Annotated[float, Real(above=0, limit=_MONTH, unit=" s")] | None = None
    """Seconds from submission, after which nobody waits for the answer: the job ends as time_limit."""
    webhook: Webhook | None = None
    """Whom to tell when the job has ended."""

    @model_validator(mode="after")
    def _starts_are_affordable(self) -> Self:
        if isinstance(self.method, GeneticMethod) and (detail := self.method.excess(self.options.starts)):
            raise refuse(detail, "options", "starts", type="limit")
        return self

    def verification_tolerances(self) -> dict[str, float]:
        """Return every tolerance of the verification, the method's own where the document gives none."""
        given = self.options.verification
        own = self.method.verification_tolerance
        tolerances = {name: getattr(given, name) for name in Verification.model_fields}
        return {name: own if value is None else float(value) for name, value in tolerances.items()}

    def implied_tolerance(self) -> float:
        """Return the relative error that is allowed of final states which follow from those of other plants.

        What the document says itself, else as on a fixed mesh whatever the method's own is.
        """
        given = self.options.verification.terminal_error
        return max(self.method.verification_tolerance, MESH_TOLERANCE) if given is None else float(given)

    def resolved(self) -> Resolution:
        """Return the document with every default written out, what was filled in, and its SHA-256."""
        return resolve(self)
