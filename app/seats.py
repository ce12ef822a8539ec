"""How many requests may wait at a time: streams of events, and answers that wait for the end of a job."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator

from app.auth import Principal
from app.errors import ServiceError

_RETRY = {"Retry-After": "5"}


class Seats:
    """Places to wait at in one process: ``together``, of which one project may take ``each``.

    Used by the event loop alone, so that nothing happens between a look and what follows from it.
    """

    def __init__(self, each: int, together: int) -> None:
        self._each = each
        self._together = together
        self._taken: Counter[str] = Counter()

    @contextlib.contextmanager
    def taken(self, principal: Principal) -> Iterator[None]:
        """Take a seat for the context; raises ServiceError where there is none."""
        refusal = self.refusal(principal)
        if refusal is not None:
            raise refusal
        self._taken[principal.project] += 1
        try:
            yield
        finally:
            self._taken[principal.project] -= 1
            if not self._taken[principal.project]:
                del self._taken[principal.project]

    def refusal(self, principal: Principal) -> ServiceError | None:
        """Return why there is no seat, None if there is one."""
        if self._taken[principal.project] >= self._each:
            detail = f"{self._each:,} requests of this project wait for events or ends of jobs; no more may."
        elif self._taken.total() >= self._together:
            detail = (
                f"{self._together:,} requests wait for events or ends of jobs; this process takes no more."
            )
        else:
            return None
        return ServiceError("too-many-waiting", detail, headers=_RETRY)
