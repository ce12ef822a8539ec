"""What a solve tells while it runs."""

import itertools
from typing import Any

import pytest

from solvers import session
from solvers.progress import ProgressReport
from solvers.solve import solve
from solvers.spec import check_document
from tests.bad_documents import FLEXIBLE_SPACECRAFT


class Listener:
    """Keeps the trajectories that are reported."""

    def __init__(self) -> None:
        self.sketches: list[Any] = []

    def report(self, report: ProgressReport) -> None:
        if report.trajectory is not None:
            self.sketches.append(report.trajectory)

    def cancelled(self) -> bool:
        return False


def test_a_running_solve_shows_now_and_then_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_SKETCH_EVERY", 0.0)
    monkeypatch.setattr("solvers.optimizers.ipopt._REPORT_EVERY", 0.0)
    listener = Listener()
    solution = solve(check_document(FLEXIBLE_SPACECRAFT | {"method": {"name": "swcm", "J": 8}}), listener)
    assert len(listener.sketches) >= 3
    for sketch in listener.sketches:
        assert len(sketch["t"]) == 41
        assert set(sketch["states"]) == {"theta", "alpha", "theta_dot", "alpha_dot"}
        assert all(before < after for before, after in itertools.pairwise(sketch["t"]))
    # The last one is close to the answer, the first is the guess.
    last = listener.sketches[-1]
    assert last["t"][-1] == pytest.approx(solution.trajectory.tf, rel=0.05)
    assert last["states"]["theta"][-1] == pytest.approx(0.5236, abs=0.05)
