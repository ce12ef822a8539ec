import json
import logging
import zlib
from typing import Any

import pytest

from solvers.errors import DocumentError, Fault
from solvers.solve import solve
from solvers.spec import check_document
from tests.bad_documents import changed
from worker.outcome import of_exception, of_solution
from worker.records import FailureType, JobStatus

ENOUGH = 2**25


def small(**options: Any) -> Any:
    document = changed("/name", "small")
    document["options"] |= options
    return check_document(document)


@pytest.mark.parametrize("metadata", [{"word": "é", "number": 1e-7}, {"number": 2**70}])
def test_a_verified_answer_succeeds(metadata: dict[str, Any]) -> None:
    spec = check_document(changed("/name", "small") | {"metadata": metadata})
    end = of_solution(solve(spec), "an id", ENOUGH)
    assert (end.status, end.error) == (JobStatus.SUCCEEDED, None)
    assert end.result is not None
    result = json.loads(zlib.decompress(end.result))
    assert (result["job_id"], result["success"]) == ("an id", True)
    assert result["resolved"]["document"]["metadata"] == metadata


def test_a_solve_without_success_fails_and_keeps_its_iterate() -> None:
    end = of_solution(solve(small(max_iterations=1)), "an id", ENOUGH)
    assert end.status is JobStatus.FAILED
    assert end.error is not None
    assert end.error.type is FailureType.ITERATION_LIMIT
    assert end.error.title == "The iteration limit was reached before convergence."
    assert end.error.detail
    assert end.result is not None
    assert json.loads(zlib.decompress(end.result))["success"] is False


def test_a_cancelled_solve_is_no_failure() -> None:
    class Cancelled:
        def report(self, report: object) -> None:
            pass

        def cancelled(self) -> bool:
            return True

    end = of_solution(solve(small(), Cancelled()), "an id", ENOUGH)
    assert (end.status, end.error) == (JobStatus.CANCELLED, None)
    assert end.result is not None


def test_a_result_that_is_too_large_is_not_kept() -> None:
    end = of_solution(solve(small()), "an id", 1_000)
    assert (end.status, end.result) == (JobStatus.FAILED, None)
    assert end.error is not None
    assert "0.000954 MiB" in end.error.detail


@pytest.mark.parametrize(
    ("error", "type", "words"),
    [
        (MemoryError(), FailureType.OUT_OF_MEMORY, "nodes"),
        (RuntimeError("Error in Function::call: std::bad_alloc"), FailureType.OUT_OF_MEMORY, "nodes"),
        (ZeroDivisionError("a secret"), FailureType.INTERNAL, "ZeroDivisionError"),
        (DocumentError([Fault("", "a secret")]), FailureType.INTERNAL, "versions"),
    ],
)
def test_what_gives_no_iterate_fails_in_words_that_may_be_told(
    error: Exception, type: FailureType, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        end = of_exception(error, "an id")
    assert (end.status, end.result) == (JobStatus.FAILED, None)
    assert end.error is not None
    assert end.error.type is type
    assert words in end.error.detail
    assert "secret" not in end.error.detail
    assert ("an id" in caplog.text) is (type is not FailureType.EVALUATION_ERROR)
