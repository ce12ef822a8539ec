"""Where predictions are made: in a process of their own, or, to compare, in this one."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Protocol

from solvers.errors import OndeletteError
from solvers.optimizers.ipopt import Limits
from solvers.piecewise.messages import Failure, First, Request
from solvers.piecewise.predict import Predictor
from solvers.piecewise.reference import Reference
from solvers.piecewise.setup import Setup

_GLANCE = 0.02
"""Seconds between two looks at whether somebody wants to stop."""


class PredictorError(OndeletteError):
    """The predictor's process ended, or failed by an error of ours."""


class Predictions(Protocol):
    """Takes a request, and gives its answer later."""

    def ask(self, request: Request) -> None:
        """Ask for a prediction."""
        ...

    def take(self, watch: Callable[[], None]) -> Reference:
        """Wait for the answer; ``watch`` is called meanwhile and may raise. Raises PredictorError."""
        ...


class RemotePredictor:
    """A predictor in a process of its own; a context manager, which ends it."""

    def __init__(self, document: dict[str, Any]) -> None:
        self._here, there = multiprocessing.Pipe()
        with there:
            self._process = subprocess.Popen(  # noqa: S603  (our own interpreter and module)
                [sys.executable, "-m", "solvers.piecewise.predictor_process", str(there.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=[there.fileno()],
                start_new_session=True,
            )
        self._here.send(document)

    @property
    def pid(self) -> int:
        """The process's id."""
        return self._process.pid

    def ask(self, request: Request) -> None:
        """See :class:`Predictions`."""
        try:
            self._here.send(request)
        except OSError as error:
            raise PredictorError("the predictor's process has ended") from error

    def take(self, watch: Callable[[], None]) -> Reference:
        """See :class:`Predictions`."""
        while not self._answered():
            watch()
        try:
            answer = self._here.recv()
        except (EOFError, OSError) as error:
            raise PredictorError("the predictor's process has ended") from error
        if isinstance(answer, Failure):
            raise PredictorError(f"the predictor failed: {answer.detail}")
        assert isinstance(answer, Reference)
        return answer

    def _answered(self) -> bool:
        try:
            return self._here.poll(_GLANCE)
        except OSError as error:
            raise PredictorError("the predictor's process has ended") from error

    def __enter__(self) -> RemotePredictor:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._here.close()
        self._process.kill()
        self._process.wait()


class LocalPredictor:
    """A predictor in this process: what is asked is worked out when it is taken, one after the other."""

    def __init__(self, setup: Setup) -> None:
        self._predictor = Predictor(setup)
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
