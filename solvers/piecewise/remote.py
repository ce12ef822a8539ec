"""Where predictions are made: in a process of their own, or, to compare, in this one."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

from solvers.companion import GLANCE, Companion
from solvers.optimizers.outcome import Limits
from solvers.piecewise.messages import First, Request
from solvers.piecewise.predict import Predictor
from solvers.piecewise.reference import Reference


class Predictions(Protocol):
    """Takes a request, and gives its answer later."""

    def ask(self, request: Request) -> None:
        """Ask for a prediction."""
        ...

    def take(self, watch: Callable[[], None]) -> Reference:
        """Wait for the answer; ``watch`` is called meanwhile and may raise. Raises CompanionError."""
        ...


class RemotePredictor(Companion):
    """A predictor in a process of its own; a context manager, which ends it."""

    def __init__(self, document: dict[str, Any]) -> None:
        super().__init__("solvers.piecewise.predictor_process")
        self.send(document)

    def ask(self, request: Request) -> None:
        """See :class:`Predictions`."""
        self.send(request)

    def take(self, watch: Callable[[], None]) -> Reference:
        """See :class:`Predictions`."""
        while not self.answered(GLANCE):
            watch()
        answer = self.receive()
        assert isinstance(answer, Reference)
        return answer


class LocalPredictor:
    """A predictor in this process: what is asked is worked out when it is taken, one after the other."""

    def __init__(self, predictor: Predictor) -> None:
        self._predictor = predictor
        self._request: Request = First(0.0)
        self._last: Reference | None = None

    def ask(self, request: Request) -> None:
        """See :class:`Predictions`."""
        self._request = request

    def take(self, watch: Callable[[], None]) -> Reference:
        """See :class:`Predictions`."""
        request = self._request
        limits = Limits(time.monotonic() + request.seconds, lambda: False)
        if isinstance(request, First):
            self._last = self._predictor.first(limits)
        else:
            assert self._last is not None
            self._last = self._predictor.following(self._last, request.true_start, limits)
        watch()
        return self._last
