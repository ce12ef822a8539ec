"""The process of the predictor: answers requests that come over a pipe, and ends with whoever started it.

Started as a program of its own, not by ``multiprocessing``: a worker's child is daemonic and may not have
such children. The pipe is its only tie: when the other end closes, be it because that process was killed,
this one ends at once, even in the middle of a prediction.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import time
from multiprocessing.connection import Connection
from typing import Any

from solvers.optimizers.ipopt import Limits
from solvers.piecewise.messages import Answer, Failure, Follow, Request
from solvers.piecewise.predict import Predictor
from solvers.piecewise.reference import Reference
from solvers.piecewise.setup import Setup
from solvers.spec import check_document


def main(descriptor: int) -> None:
    """Serve the other end of the socket ``descriptor``: first the document comes, then requests."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who started it decides
    connection = Connection(descriptor)
    requests: queue.SimpleQueue[Any] = queue.SimpleQueue()
    predictor: Predictor | None = None
    reference: Reference | None = None
    threading.Thread(target=_listen, args=(connection, requests), daemon=True).start()
    while True:
        request = requests.get()
        try:
            if predictor is None:
                predictor = Predictor(Setup.of(check_document(request)))
                continue
            reference = _answer(predictor, request, reference)
            answer: Answer = reference
        except Exception as error:  # noqa: BLE001  (raised again where the request came from)
            answer = Failure(f"{type(error).__name__}: {error}")
        connection.send(answer)


def _answer(predictor: Predictor, request: Request, reference: Reference | None) -> Reference:
    limits = Limits(time.monotonic() + request.seconds, lambda: False)
    if isinstance(request, Follow):
        assert reference is not None
        return predictor.following(reference, request.true_start, limits)
    return predictor.first(limits)


def _listen(connection: Connection, requests: queue.SimpleQueue[Any]) -> None:
    """Take requests while the main thread works; end the process when nobody can send any more."""
    try:
        while True:
            requests.put(connection.recv())
    except (EOFError, OSError):
        os._exit(0)


if __name__ == "__main__":
    main(int(sys.argv[1]))
