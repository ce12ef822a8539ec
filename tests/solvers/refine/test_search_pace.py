"""When a search for arcs gives its nodes up."""

from __future__ import annotations

from solvers.refine.search import Pace


def test_nodes_that_help_may_become_many() -> None:
    pace = Pace()
    assert all(pace.helps(20 * 2**step, 1e-2 / 3**step) for step in range(12))


def test_arcs_that_are_missing_are_not_made_up_for_by_nodes() -> None:
    """The error of a switch in the middle of an arc falls with the first power of the nodes at best."""
    pace = Pace()
    assert pace.helps(20, 1e-2)
    assert pace.helps(40, 0.8e-2)
    assert pace.helps(80, 0.5e-2)
    assert not pace.helps(160, 0.3e-2)
