"""Flights of a bundle flown again: the same seed draws the same numbers, so they end as they did."""

from __future__ import annotations

from typing import Any

import numpy as np

from solvers.errors import DocumentError
from solvers.flights.fly import FlightsStopped
from solvers.flights.run import run_flights
from solvers.output.bundle import Bundle, BundleError
from solvers.spec import parse_document
from solvers.spec.flights import check_flights
from solvers.verification.flight import FlightError

AGREEMENT = 1e-6
"""Largest difference, in parts of what is larger than 1, that is rounding."""


def flights_again(bundle: Bundle) -> dict[str, float]:
    """Fly what a bundle of flights holds again; return for each column the largest difference to the result.

    Differences are relative to the largest magnitude in the column, at least 1; infinite where a flight was
    lost that is not lost now, or the other way round, or a column is missing. Raises BundleError.
    """
    if bundle.result is None or bundle.flown is None:
        missing = "no result" if bundle.result is None else "no answer that was flown"
        raise BundleError(f"the bundle of flights has {missing}, so there is nothing to fly again")
    try:
        spec = check_flights(parse_document(bundle.document), bundle.flown["resolved"]["document"])
        now = run_flights(spec, bundle.flown).result()["columns"]
        then = bundle.result["columns"]
        return {name: _difference(then.get(name), values) for name, values in now.items()}
    except (FlightsStopped, FlightError) as error:
        raise BundleError(f"the answer cannot be flown again: {error}") from error
    except (DocumentError, KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise BundleError(
            f"the flights cannot be read by this version ({type(error).__name__}: {error})"
        ) from error


def _difference(then: Any, now: Any) -> float:
    before, after = (np.array([] if column is None else column, dtype=float) for column in (then, now))
    if before.shape != after.shape or (np.isnan(before) != np.isnan(after)).any():
        return float("inf")
    known = ~np.isnan(before)
    if not known.any():
        return 0.0
    return float(np.abs(before - after)[known].max() / max(1.0, np.abs(before[known]).max()))
