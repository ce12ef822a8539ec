"""The process of the predictor: answers requests that come over a pipe, and ends with whoever started it."""

from __future__ import annotations

import sys
import time

from solvers.companion import Failure, serve
from solvers.optimizers.outcome import Limits
from solvers.piecewise.messages import Follow, Request
from solvers.piecewise.predict import Predictor
from solvers.piecewise.reference import Reference
from solvers.piecewise.setup import Setup
from solvers.spec import check_document


def main(descriptor: int) -> None:
    """Serve the other end of the socket ``descriptor``: first the document comes, then requests."""
    connection, requests = serve(descriptor)
    predictor: Predictor | None = None
    reference: Reference | None = None
    while True:
        request = requests.get()
        try:
            if predictor is None:
                predictor = Predictor(Setup.of(check_document(request)))
                continue
            reference = _answer(predictor, request, reference)
            answer: Reference | Failure = reference
        except Exception as error:  # noqa: BLE001  (raised again where the request came from)
            answer = Failure(f"{type(error).__name__}: {error}")
        connection.send(answer)


def _answer(predictor: Predictor, request: Request, reference: Reference | None) -> Reference:
    limits = Limits(time.monotonic() + request.seconds, lambda: False)
    if isinstance(request, Follow):
        assert reference is not None
        return predictor.following(reference, request.true_start, limits)
    return predictor.first(limits)


if __name__ == "__main__":
    main(int(sys.argv[1]))
