"""Strict JSON: what Python's reader lets pass is refused, each place by its pointer."""

from __future__ import annotations

import json
import time
from typing import Any

import pytest

from solvers.errors import DocumentError, Fault
from solvers.spec import check_document, parse_document


def faults_of(raw: bytes | str) -> tuple[Fault, ...]:
    with pytest.raises(DocumentError) as caught:
        parse_document(raw)
    return caught.value.faults


@pytest.mark.parametrize(
    "text",
    ['{"a": [1, -2.5, 1e-3, true, null, "x"]}', "[]", "3", '"é\\u00e9"', ' {"a": {}} ', "1.7e308", "1e-400"],
)
def test_json_is_read_as_it_is(text: str) -> None:
    assert parse_document(text) == json.loads(text)
    assert parse_document(text.encode()) == json.loads(text)


def test_byte_order_mark_is_no_fault() -> None:
    assert parse_document(b"\xef\xbb\xbf{}") == {}


@pytest.mark.parametrize(
    ("literal", "word"),
    [
        ("NaN", "finite"),
        ("Infinity", "finite"),
        ("-Infinity", "finite"),
        ("1e400", "finite"),
        ("-1e400", "finite"),
        ("1" * 400, "finite"),
        ("-" + "1" * 5000, "finite"),
        ("9" * 310, "finite"),
        ("1" * 5000 + ".5", "finite"),
        ('"\\ud800"', "surrogate"),
        ('{"x": 1, "x": 2}', "'x' stands more than once"),
    ],
)
def test_what_is_refused_has_a_pointer(literal: str, word: str) -> None:
    for text, pointer in (
        (literal, ""),
        (f'{{"a": {{"b": [0, {literal}]}}}}', "/a/b/1"),
        (f'{{"~/": {literal}}}', "/~0~1"),
    ):
        (fault,) = faults_of(text)
        assert fault.pointer == (pointer + "/x" if literal.startswith("{") else pointer)
        assert word in fault.detail


def test_the_largest_numbers_are_allowed() -> None:
    assert parse_document(str(10**308)) == 10**308
    assert parse_document("-1.7976931348623157e308") == -1.7976931348623157e308


def test_all_places_are_reported_in_order() -> None:
    found = faults_of('{"a": NaN, "b": {"c": 1, "c": 2, "d": [1e999]}, "e": [1, "\\udfff"]}')
    assert [fault.pointer for fault in found] == ["/a", "/b/c", "/b/d/0", "/e/1"]


def test_half_a_surrogate_in_a_key_can_be_reported() -> None:
    (fault,) = faults_of('{"\\ud800": 1}')
    assert fault.pointer.encode() == b"/\\ud800"
    assert "surrogate" in fault.detail


@pytest.mark.parametrize(
    ("raw", "word"),
    [
        (b"", "line 1, column 1"),
        (b'{"a": 1,\n "b": }', "line 2, column 7"),
        (b"{'a': 1}", "line 1, column 2"),
        (b'{"a": 1} x', "line 1, column 10"),
        (b"\xff\xfe", "byte 1"),
        (b'{"a": "\xff"}', "byte 8"),
        ('{"a": 1}'.encode("utf-16"), "UTF-8"),
    ],
)
def test_what_is_not_json_is_refused_with_its_place(raw: bytes, word: str) -> None:
    (fault,) = faults_of(raw)
    assert fault.pointer == ""
    assert word in fault.detail


@pytest.mark.parametrize("levels", [65, 500, 100_000])
@pytest.mark.parametrize(("opening", "closing"), [("[", "]"), ('{"a":', "}")])
def test_nesting_is_limited(levels: int, opening: str, closing: str) -> None:
    (fault,) = faults_of(opening * levels + "1" + closing * levels)
    assert fault.type == "limit"
    assert "64 levels" in fault.detail
    parse_document(opening * 64 + "1" + closing * 64)


@pytest.mark.parametrize(
    "raw",
    [
        b"{" + b",".join(b'"a%d":1,"a%d":2' % (i, i) for i in range(50_000)) + b"}",
        b"[" + b",".join([b"NaN"] * 200_000) + b"]",
        b'{"a":' + b"[" * 1_000_000,
        b'["' + b"\\ud800" * 200_000 + b'"]',
        b"9" * 1_000_000,
    ],
)
def test_hostile_text_costs_little(raw: bytes) -> None:
    start = time.process_time()
    assert 1 <= len(faults_of(raw)) <= 1000
    assert time.process_time() - start < 3


@pytest.mark.parametrize(
    ("value", "pointer", "word"),
    [
        ({"metadata": {"day": b"x"}}, "/metadata/day", "bytes is not a JSON value"),
        ({"metadata": {1: 2}}, "/metadata/1", "a key must be text, not a number"),
        ({"metadata": {"x": float("nan")}}, "/metadata/x", "finite"),
        ({"metadata": {"x": (1, 2)}}, "/metadata/x", "not a JSON value"),
        ({True: 1}, "/True", "a key must be text"),
    ],
)
def test_a_document_from_elsewhere_must_be_json_too(value: Any, pointer: str, word: str) -> None:
    with pytest.raises(DocumentError) as caught:
        check_document(value)
    (fault,) = caught.value.faults
    assert fault.pointer == pointer
    assert word in fault.detail


@pytest.mark.parametrize("value", [None, [], 3, "x", True])
def test_a_document_is_an_object(value: object) -> None:
    with pytest.raises(DocumentError) as caught:
        check_document(value)
    (fault,) = caught.value.faults
    assert fault.pointer == ""
    assert "object" in fault.detail
