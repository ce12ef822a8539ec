import logging

import pytest
from redis.exceptions import ConnectionError, RedisError

from worker.patience import patiently


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
