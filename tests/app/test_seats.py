"""Seats for requests that wait: so many for each project, so many for a process."""

import contextlib

import pytest

from app.auth import Principal
from app.errors import ServiceError
from app.seats import Seats


def test_seats_are_counted_for_each_project_and_for_the_process() -> None:
    seats = Seats(2, 3)
    one, other, third = (Principal("key", project) for project in ("one", "other", "third"))
    with contextlib.ExitStack() as sitting:
        for principal in (one, one, other):
            sitting.enter_context(seats.taken(principal))
        for principal, words in ((one, "2 requests of this project"), (third, "3 requests wait")):
            with pytest.raises(ServiceError, match=words) as refused, seats.taken(principal):
                pass
            assert refused.value.problem.status == 429
            assert refused.value.headers["Retry-After"]
    with pytest.raises(ZeroDivisionError), seats.taken(third):
        1 / 0  # noqa: B018
    assert all(seats.refusal(principal) is None for principal in (one, other, third))
