"""The ``phases`` of a problem, flown one after the other, and the ``links`` between them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from solvers.expressions import quoted
from solvers.spec.attitude import TargetQuaternion
from solvers.spec.base import SpecModel
from solvers.spec.checks import check_expression
from solvers.spec.faults import Flaws, refuse
from solvers.spec.fields import VALUE_SCHEMA, Bound, Check, ShapedCheck, Text
from solvers.spec.models import SubmittedModel
from solvers.spec.parts import (
    BoundaryConstraints,
    Bounds,
    Ends,
    Guess,
    Integrals,
    Objective,
    OfControls,
    Outputs,
    PathConstraints,
)
from solvers.spec.phase_merge import PhaseView, phase_views
from solvers.spec.scenarios import CaseParameters
from solvers.spec.scope import Scope, read_scope
from solvers.spec.tables import UnitTable, list_of, object_of, unknown_key
from solvers.spec.values import Value

MAX_PHASES = 16
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*", re.ASCII)
_LONGEST = 64


class PhaseName(Text):
    """The name of a phase: a letter, then letters, digits and ``_``."""

    def check(self, value: Any, scope: Scope) -> str:
        """Return the name."""
        name = super().check(value, scope)
        if not _NAME.fullmatch(name):
            raise refuse(f"{quoted(name)} is not a name: a letter, then letters, digits and _")
        return name

    def schema(self) -> dict[str, Any]:
        """A short text."""
        return {**super().schema(), "pattern": f"^{_NAME.pattern}$"}


class JumpTable(Check):
    """State of the next phase -> its value there, in what the phase before ends with; ``null`` is free."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table as submitted; its names are judged with the phases that it joins."""
        return object_of(value)

    def schema(self) -> dict[str, Any]:
        """An object of expressions."""
        entry = {"anyOf": [*VALUE_SCHEMA["anyOf"], {"type": "null"}]}
        return {"type": "object", "additionalProperties": entry}


class PhaseSpec(SpecModel):
    """A part of the flight, as a problem; what it does not say stands beside ``phases``."""

    name: Annotated[str, PhaseName(_LONGEST)]
    """Its name in links and in the result."""
    submitted_model: Annotated[SubmittedModel, Field(discriminator="kind")] | None = Field(
        None, alias="model"
    )
    """Equations of motion of its own; then nothing that speaks of names of the common model is taken over."""
    parameters: Annotated[dict[str, Value], CaseParameters()] = Field(default_factory=dict)
    """Parameter of the model -> its value in this phase."""
    initial_time: Bound | None = None
    """When it begins; without it when the phase before ends."""
    final_time: Bound | None = None
    """When it ends, counted as all times are; without it when the optimum wants it to."""
    initial_state: Ends = Field(default_factory=dict)
    """State -> bound at its begin; what is not named follows from the link."""
    final_state: Ends = Field(default_factory=dict)
    """State -> bound at its end; states that are not named are free."""
    final_attitude: Annotated[list[Value], TargetQuaternion()] | None = None
    """Quaternion, scalar part last, in which this phase ends, or its negative; not with q1 to q4 in
    ``final_state``."""
    bounds: Bounds = Field(default_factory=dict)
    """State or control -> bound along this phase, instead of the common one."""
    control_rates: OfControls = Field(default_factory=dict)
    """Control -> bound of its rate in this phase."""
    initial_control: OfControls = Field(default_factory=dict)
    """Control -> bound at its begin."""
    final_control: OfControls = Field(default_factory=dict)
    """Control -> bound at its end."""
    path_constraints: PathConstraints = Field(default_factory=list)
    """Constraints along this phase, besides the common ones."""
    boundary_constraints: BoundaryConstraints = Field(default_factory=list)
    """Constraints on both ends of this phase."""
    integrals: Integrals = Field(default_factory=list)
    """Integrals over this phase, besides the common ones, which add up over all phases."""
    outputs: Outputs = Field(default_factory=list)
    """Expressions that are sampled in this phase, besides the common ones."""
    objective: Objective | None = None
    """What this phase adds to the objective."""
    guess: Guess | None = None
    """Where the search for this phase starts."""
    units: Annotated[dict[str, str], UnitTable()] = Field(default_factory=dict)
    """Name -> label of its unit, of a model of its own."""


class LinkSpec(SpecModel):
    """How a phase begins where the one before ends: with every state of the same name, unless it jumps."""

    before: Annotated[str, Text()] = Field(alias="from")
    """The phase that ends."""
    after: Annotated[str, Text()] = Field(alias="to")
    """The phase that begins, the next one."""
    jump: Annotated[dict[str, Value | None], JumpTable()] = Field(default_factory=dict)
    """State of the phase that begins -> expression in <state>_f, <control>_f, <output>_f, tf and parameters
    of the phase that ends, or null where it is free."""


class PhaseList(ShapedCheck):
    """Phases, each read in the names of its own model."""

    def check(self, value: Any, scope: Scope) -> list[Any]:
        """Return the phases."""
        from solvers.spec.translate import nested  # which knows every object of a document, this one too

        entries, flaws = list_of(value), Flaws()
        if len(entries) > MAX_PHASES:
            raise refuse(f"limit: at most {MAX_PHASES} phases, not {len(entries):,}", type="limit")
        views = phase_views(scope.problem)
        phases = []
        for entry, view in zip(entries, views, strict=True):
            own = phase_scope(scope, view)
            found = Flaws()
            phases.append(nested(PhaseSpec, entry, own, found))
            flaws.take(found, view.index)
        flaws.raise_any()
        return phases


class LinkList(ShapedCheck):
    """Links, each read in the names of the phases that it joins."""

    def check(self, value: Any, scope: Scope) -> list[Any]:
        """Return the links."""
        from solvers.spec.translate import nested

        entries, flaws = list_of(value), Flaws()
        if len(entries) > MAX_PHASES:
            raise refuse(f"limit: at most {MAX_PHASES} links, not {len(entries):,}", type="limit")
        views = phase_views(scope.problem)
        links = []
        for index, entry in enumerate(entries):
            found = Flaws()
            link = nested(LinkSpec, entry, scope, found)
            if link is not None:
                links.append(link)
                if views:
                    _check_link(link, views, scope, found)
            flaws.take(found, index)
        flaws.raise_any()
        return links


def phase_scope(scope: Scope, view: PhaseView) -> Scope:
    """Return the names that a phase of the document of ``scope`` may use."""
    names = view.fields(None, None)
    own = read_scope({**scope.document, "problem": names})
    own.suggestions = scope.suggestions
    return own


def flown_scopes(scope: Scope) -> list[Scope]:
    """Return the names of each phase of the document of ``scope``; of the document where it has none."""
    return [phase_scope(scope, view) for view in phase_views(scope.problem)[:MAX_PHASES]] or [scope]


def flown_names(scopes: Sequence[Scope], kind: Literal["controls", "parameter_names"]) -> list[str]:
    """Return the controls or the parameters that any phase has."""
    return list(dict.fromkeys(name for own in scopes for name in getattr(own, kind)))


def _check_link(link: LinkSpec, views: Sequence[PhaseView], scope: Scope, flaws: Flaws) -> None:
    names = [view.phase.get("name") for view in views]
    for key, name in (("from", link.before), ("to", link.after)):
        if name not in names:
            known = [item for item in names if isinstance(item, str)]
            flaws.add(unknown_key(name, "phase", known, scope), key)
    if flaws.found:
        return
    at = names.index(link.before)
    if names.index(link.after) != at + 1:
        follows = f"{quoted(str(names[at + 1]))} follows" if at + 1 < len(names) else "no phase follows"
        flaws.add(f"phases are flown in their order: {follows} {quoted(link.before)}", "to")
        return
    ending, beginning = (phase_scope(scope, view) for view in views[at : at + 2])
    if not ending.known or not beginning.known:
        return
    # What is known at the end of the phase before: nothing of its begin, and no integrals.
    ends = {f"{name}_f" for name in (*ending.states, *ending.controls, *ending.output_names)}
    ending.boundary_names = ending.parameter_names.union(ends, ("tf",))
    states = (*beginning.states, *beginning.rated)
    for name, expression in link.jump.items():
        if name not in states:
            what = f"state of the phase {quoted(link.after)}"
            flaws.add(unknown_key(name, what, states, scope), "jump", name)
        elif expression is not None:
            check_expression(expression, "boundary", ending, flaws, "jump", name)
