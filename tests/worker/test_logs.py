"""Log lines: what they are about, and that machines can read them."""

from __future__ import annotations

import json
import logging
import sys
import threading

import pytest

from worker import logs


@pytest.fixture
def record() -> logging.LogRecord:
    return logging.LogRecord("a.logger", logging.WARNING, __file__, 1, "it is %s", ("cold",), None)


def test_a_line_for_machines(record: logging.LogRecord) -> None:
    record.status = 202
    with logs.about(request="R", job="J"):
        members = json.loads(logs.JsonFormatter().format(record))
    assert members.pop("time").endswith("+00:00")
    assert members == {
        "level": "warning",
        "logger": "a.logger",
        "message": "it is cold",
        "request_id": "R",
        "job_id": "J",
        "status": 202,
    }
    assert "job_id" not in json.loads(logs.JsonFormatter().format(record))


def test_an_exception_stays_in_its_line(record: logging.LogRecord) -> None:
    try:
        raise ValueError("two\nlines")
    except ValueError:
        record.exc_info = sys.exc_info()
    text = logs.JsonFormatter().format(record)
    assert "\n" not in text
    assert "ValueError: two\nlines" in json.loads(text)["exception"]


def test_a_line_for_people(record: logging.LogRecord) -> None:
    with logs.about(request="R"):
        assert logs.TextFormatter().format(record).endswith("WARNING it is cold request_id=R")
        record.msg, record.args = "request R is cold", ()
        assert logs.TextFormatter().format(record).endswith("request R is cold")


def test_what_it_is_about_ends_with_the_context() -> None:
    with logs.about(request="R"):
        with logs.about(job="J"):
            assert (logs.request_id.get(), logs.job_id.get()) == ("R", "J")
        assert logs.job_id.get() is None
        seen = []
        thread = threading.Thread(target=lambda: seen.append(logs.request_id.get()))
        thread.start()
        thread.join()
        assert seen == [None]
    assert logs.request_id.get() is None
