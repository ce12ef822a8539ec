"""What an estimate of the error between nodes is worth."""

from __future__ import annotations

from solvers.verification.verdict import Verification

_ROUNDING = 1e-10
"""Errors of states below this, relative, are those of the arithmetic and of the integration."""


def assert_estimate_is_true(verification: Verification, factor: float = 10.0) -> None:
    """The estimate is within this factor of what the integration finds; both small where that is rounding."""
    estimate, true = verification.mesh_error_estimate, verification.max_state_error
    assert estimate is not None
    assert true is not None
    if true < _ROUNDING:
        assert estimate <= 1e-8
    else:
        assert 1.0 / factor < true / estimate < factor
