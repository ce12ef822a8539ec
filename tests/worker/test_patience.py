import logging
import signal
import subprocess
import sys

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


TOO_LONG = """
import sys
from worker.patience import process_limit

with process_limit(60):
    pass
with process_limit(float(sys.argv[1])):
    pow(3, 10**9, 7 ** 10**7)  # One call of a library that hears no signal.
"""


def test_a_process_is_ended_in_the_middle_of_a_call_of_a_library() -> None:
    command = [sys.executable, "-c", TOO_LONG, "0.2"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == -signal.SIGALRM
    assert "most recent call first" in ended.stderr


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
