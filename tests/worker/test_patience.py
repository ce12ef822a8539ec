import logging
import signal

import pytest
from redis.exceptions import ConnectionError, RedisError

from worker.patience import patiently, process_limit


def test_a_store_that_comes_back_is_asked_again(caplog: pytest.LogCaptureFixture) -> None:
    answers = [ConnectionError("away"), RedisError("full"), "an answer"]

    def ask() -> str:
        answer = answers.pop(0)
        if isinstance(answer, RedisError):
            raise answer
        return str(answer)

    with caplog.at_level(logging.WARNING):
        assert patiently(ask, 10, "a job") == "an answer"
    assert caplog.text.count("the store does not answer") == 1


def test_an_alarm_set_before_is_set_again_afterwards() -> None:
    handler = signal.getsignal(signal.SIGALRM)
    before, _ = signal.setitimer(signal.ITIMER_REAL, 50.0)
    try:
        with process_limit(60):
            assert 50 < signal.getitimer(signal.ITIMER_REAL)[0] <= 60
        assert 40 < signal.getitimer(signal.ITIMER_REAL)[0] <= 50
    finally:
        signal.setitimer(signal.ITIMER_REAL, before)
    assert signal.getsignal(signal.SIGALRM) is handler


def test_patience_has_its_end() -> None:
    def ask() -> str:
        raise ConnectionError("away")

    with pytest.raises(ConnectionError):
        patiently(ask, 0, "a job")


def test_other_errors_are_not_waited_out() -> None:
    def ask() -> str:
        raise ValueError

    with pytest.raises(ValueError):  # noqa: PT011  (it has nothing to say)
        patiently(ask, 10, "a job")
