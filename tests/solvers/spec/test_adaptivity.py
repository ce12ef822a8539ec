"""The ``adaptive`` object of a method: its defaults, its limits, and what it means for the verification."""

from __future__ import annotations

from typing import Any

import pytest

from solvers.errors import DocumentError, Fault
from solvers.sizes import problem_size
from solvers.spec import JobSpec, check_document


def checked(document: dict[str, Any], **method: Any) -> JobSpec:
    return check_document({**document, "method": method})


def fault(document: dict[str, Any], **method: Any) -> Fault:
    with pytest.raises(DocumentError) as refusal:
        checked(document, **method)
    (found,) = refusal.value.faults
    return found


@pytest.mark.parametrize(
    ("name", "defaults"),
    [
        ("swcm", {"tolerance": 1e-6, "max_level": 10}),
        ("gpm", {"tolerance": 1e-8}),
        ("hermite_simpson", {"tolerance": 1e-8}),
    ],
)
def test_defaults_are_written_out(rigid_body: dict[str, Any], name: str, defaults: dict[str, Any]) -> None:
    resolution = checked(rigid_body, name=name, adaptive={}).resolved()
    assert resolution.document["method"]["adaptive"] == defaults
    assert "/method/adaptive/tolerance" in resolution.defaults_applied


def test_the_tolerance_is_that_of_the_verification_unless_the_document_says_otherwise(
    rigid_body: dict[str, Any],
) -> None:
    adaptive = {"tolerance": "2e-5/2"}
    spec = checked(rigid_body, name="swcm", adaptive=adaptive)
    assert set(spec.verification_tolerances().values()) == {1e-5}
    spec = checked(
        {**rigid_body, "options": {"verification": {"bound": 1e-3}}}, name="swcm", adaptive=adaptive
    )
    assert spec.verification_tolerances()["bound"] == 1e-3
    assert set(checked(rigid_body, name="swcm").verification_tolerances().values()) == {1e-2}


@pytest.mark.parametrize(
    ("method", "place", "words"),
    [
        ({"name": "swcm", "adaptive": True}, "", "must be an object"),
        ({"name": "swcm", "adaptive": []}, "", "must be an object"),
        ({"name": "swcm", "adaptive": {"tolerance": 0}}, "/tolerance", "greater than 0"),
        ({"name": "gpm", "adaptive": {"tolerance": -1e-8}}, "/tolerance", "greater than 0"),
        ({"name": "gpm", "adaptive": {"tolerance": 2}}, "/tolerance", "at most 1"),
        ({"name": "gpm", "adaptive": {"tolerance": None}}, "/tolerance", "must be"),
        ({"name": "gpm", "adaptive": {"max_level": 3}}, "/max_level", "unknown key"),
        ({"name": "swcm", "adaptive": {"tolerence": 1e-6}}, "/tolerence", "did you mean 'tolerance'"),
        ({"name": "swcm", "adaptive": {"max_level": 21}}, "/max_level", "at most 20 levels"),
        ({"name": "swcm", "adaptive": {"max_level": -1}}, "/max_level", "at least 0"),
        ({"name": "swcm", "adaptive": {"max_level": 2.5}}, "/max_level", "whole number"),
    ],
)
def test_what_is_malformed_is_refused_at_its_place(
    rigid_body: dict[str, Any], method: dict[str, Any], place: str, words: str
) -> None:
    found = fault(rigid_body, **method)
    assert found.pointer == "/method/adaptive" + place
    assert words in found.detail


def test_the_first_mesh_is_no_finer_than_the_finest(rigid_body: dict[str, Any]) -> None:
    spec = checked(rigid_body, name="swcm", J=6, adaptive={"max_level": 2})
    assert problem_size(spec).nodes == 8 * 2**2 + 3
    plain = checked(rigid_body, name="swcm", J=2)
    assert problem_size(spec).variables == problem_size(plain).variables
    assert problem_size(spec).seconds > problem_size(plain).seconds
