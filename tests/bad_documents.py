"""The table of bad job documents: what each is, where its fault must be named, and of what type it is.

The tests of the HTTP interface and of the command line run over the same table: none of these may be taken
for a problem, crash or hang a process, or reach a worker.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

FLEXIBLE_SPACECRAFT: dict[str, Any] = {
    "name": "Flexible spacecraft, 30 deg slew, minimum time",
    "tags": ["slew"],
    "schema": 1,
    "problem": {
        "model": {
            "kind": "mechanical",
            "coordinates": ["theta", "alpha"],
            "controls": ["T"],
            "parameters": {"Jb": 440, "R": 2.5, "m": 10, "L": 5, "k": 100},
            "mass": [
                ["Jb + 2*m*(R^2 + L^2 + 2*R*L*cos(alpha))", "2*m*(L^2 + R*L*cos(alpha))"],
                ["2*m*(L^2 + R*L*cos(alpha))", "2*m*L^2"],
            ],
            "damping": [
                ["-2*m*R*L*sin(alpha)*alpha_dot", "-2*m*R*L*sin(alpha)*(theta_dot + alpha_dot)"],
                ["2*m*R*L*sin(alpha)*theta_dot", 0],
            ],
            "stiffness": [[0, 0], [0, "2*k"]],
            "input": [[1], [0]],
        },
        "initial_time": 0,
        "final_time": [1, 100],
        "initial_state": {"theta": 0, "alpha": 0, "theta_dot": 0, "alpha_dot": 0},
        "final_state": {"theta": "pi/6", "alpha": 0, "theta_dot": 0, "alpha_dot": 0},
        "bounds": {"T": [-5, 5]},
        "path_constraints": [],
        "boundary_constraints": [],
        "objective": {"terminal": "tf"},
        "guess": {"final_time": 30},
    },
    "method": {"name": "swcm", "L": 8, "J": 4},
    "options": {"tolerance": 1e-8, "max_iterations": 3000, "max_seconds": 60},
    "output": {"samples": 201},
}
"""A good document, from which most of the bad ones are made by one change."""

OVERSIZED_BYTES = 60_000_000
"""Length of a body far beyond the limit of 2 MiB, in bytes."""


@dataclass(frozen=True)
class BadDocument:
    """A text that is no good job document.

    ``pointer`` is where one of its faults must be reported (None where the text is no JSON: there is no
    place to point at), ``type`` the type of that fault.
    """

    name: str
    raw: bytes
    pointer: str | None
    type: str = "invalid"


def changed(pointer: str, value: Any) -> dict[str, Any]:
    """Return the good document with one value set (a name that is not there yet is added)."""
    document = copy.deepcopy(FLEXIBLE_SPACECRAFT)
    *way, last = pointer.split("/")[1:]
    place: Any = document
    for step in way:
        place = place[int(step)] if isinstance(place, list) else place[step]
    place[int(last) if isinstance(place, list) else last] = value
    return document


def without(pointer: str) -> dict[str, Any]:
    """Return the good document without one of its keys."""
    document = copy.deepcopy(FLEXIBLE_SPACECRAFT)
    *way, last = pointer.split("/")[1:]
    place: Any = document
    for step in way:
        place = place[step]
    del place[last]
    return document


def oversized_body(chunk: int = 65_536) -> Iterator[bytes]:
    """Yield a well-formed JSON document of `OVERSIZED_BYTES` bytes piece by piece."""
    head, tail = b'{"notes": "', b'"}'
    yield head
    left = OVERSIZED_BYTES - len(head) - len(tail)
    while left:
        piece = min(chunk, left)
        yield b"x" * piece
        left -= piece
    yield tail


def _text(good: str, bad: str) -> bytes:
    """Return the good document's text with one piece of it replaced, for what `json.dumps` does not write."""
    text = json.dumps(FLEXIBLE_SPACECRAFT)
    assert text.count(good) == 1, good
    return text.replace(good, bad).encode()


_MASS = "/problem/model/mass/0/0"
_MODEL = "/problem/model"


def _expressions() -> Iterator[BadDocument]:
    for name, text in {
        "unknown name": "Jc + 2*m",
        "attribute access": "alpha.__class__",
        "attribute access on a number": "(1).real",
        "call of a builtin": "eval(alpha)",
        "import": "__import__('os').system('true')",
        "subscript": "alpha[0]",
        "lambda": "lambda: alpha",
        "comparison": "alpha < 1",
        "string": "'alpha'",
        "assignment": "alpha := 1",
        "two statements": "alpha; m",
        "wrong number of arguments": "cos(alpha, m)",
        "min of one": "min(alpha)",
        "function without call": "cos + 1",
        "call of a parameter": "m(alpha)",
        "open parenthesis": "2*(m + L",
        "empty": "",
        "only a sign": "-",
        "exponent overflow": "1e400",
        "nan by name": "nan",
        "inf by name": "inf",
        "not ASCII": "2*mµ",
        "full-width digits": "\uff11\uff12",
        "control character": "2*m\u0000",
    }.items():
        yield BadDocument(f"expression: {name}", _json(changed(_MASS, text)), _MASS)
    for name, text in {
        "100,000 minus signs": "-" * 100_000 + "1",
        "4,000 minus signs": "-" * 4_000 + "1",
        "250 parentheses": "(" * 250 + "1" + ")" * 250,
        "too many operations": "1" + "+1" * 2_040,
        "200,000 operations": "m" + "+m" * 200_000,
        "power tower": "m" + "^m" * 300,
    }.items():
        yield BadDocument(f"expression: {name}", _json(changed(_MASS, text)), _MASS, "limit")
    yield BadDocument("expression: 3,000 digits", _json(changed(_MASS, "1" * 3_000)), _MASS)
    yield BadDocument(
        "expression: overflow of a parameter",
        _json(changed(f"{_MODEL}/parameters/Jb", "exp(1000)")),
        f"{_MODEL}/parameters/Jb",
    )
    yield BadDocument(
        "expression: division by zero",
        _json(changed(f"{_MODEL}/parameters/Jb", "1/0")),
        f"{_MODEL}/parameters/Jb",
    )
    yield BadDocument(
        "expression: control in a bound",
        _json(changed("/problem/bounds/T", ["-T", 5])),
        "/problem/bounds/T/0",
    )
    yield BadDocument(
        "expression: state in the objective",
        _json(changed("/problem/objective/terminal", "theta")),
        "/problem/objective/terminal",
    )


def _numbers() -> Iterator[BadDocument]:
    pointer = f"{_MODEL}/parameters/Jb"
    for name, literal in {
        "NaN": "NaN",
        "Infinity": "Infinity",
        "-Infinity": "-Infinity",
        "1e400": "1e400",
        "5,000 digits": "1" * 5_000,
        "5,000 digits and a fraction": "1" * 5_000 + ".5",
    }.items():
        # The pointer is asked for only where JSON itself has a word for the number.
        yield BadDocument(f"number: {name}", _text('"Jb": 440', f'"Jb": {literal}'), None)
    yield BadDocument("number: true", _json(changed(pointer, True)), pointer)
    yield BadDocument("number: null", _json(changed(pointer, None)), pointer)
    yield BadDocument("number: list", _json(changed(pointer, [440])), pointer)
    guess = "/problem/guess/final_time"
    yield BadDocument("number: no finite guess", _json(changed(guess, "1/(k - k)")), guess)
    yield BadDocument("number: J by a parameter", _json(changed("/method/J", "k/25.0001")), "/method/J")
    yield BadDocument("number: J as fraction", _json(changed("/method/J", 4.5)), "/method/J")
    yield BadDocument("number: J negative", _json(changed("/method/J", -1)), "/method/J")
    yield BadDocument("number: L too small", _json(changed("/method/L", 4)), "/method/L")
    yield BadDocument("number: tolerance 0", _json(changed("/options/tolerance", 0)), "/options/tolerance")
    yield BadDocument("number: schema 2", _json(changed("/schema", 2)), "/schema")


def _shapes() -> Iterator[BadDocument]:
    mass = f"{_MODEL}/mass"
    yield BadDocument("matrix: not square", _json(changed(mass, [[1, 0, 0], [0, 1, 0]])), f"{mass}/0")
    yield BadDocument("matrix: one row missing", _json(changed(mass, [[1, 0]])), mass)
    yield BadDocument("matrix: ragged", _json(changed(mass, [[1, 0], [1]])), f"{mass}/1")
    yield BadDocument("matrix: empty", _json(changed(mass, [])), mass)
    yield BadDocument("matrix: a number", _json(changed(mass, 3)), mass)
    yield BadDocument(
        "matrix: input too wide", _json(changed(f"{_MODEL}/input", [[1, 0], [0, 1]])), f"{_MODEL}/input/0"
    )
    yield BadDocument(
        "matrix: force too long", _json(changed(f"{_MODEL}/force", [0, 0, 0])), f"{_MODEL}/force"
    )
    yield BadDocument("matrix: singular", _json(changed(mass, [[1, 1], [1, 1]])), mass)
    yield BadDocument(
        "matrix: singular at the start only", _json(changed(mass, [["1 - cos(alpha)", 0], [0, 1]])), mass
    )


def _ends() -> Iterator[BadDocument]:
    yield BadDocument("bounds: crossed", _json(changed("/problem/bounds/T", [5, -5])), "/problem/bounds/T")
    yield BadDocument(
        "bounds: crossed time", _json(changed("/problem/final_time", [100, 1])), "/problem/final_time"
    )
    yield BadDocument(
        "bounds: three values", _json(changed("/problem/bounds/T", [-5, 0, 5])), "/problem/bounds/T"
    )
    yield BadDocument("bounds: of nothing", _json(changed("/problem/bounds/Q", [-5, 5])), "/problem/bounds/Q")
    yield BadDocument(
        "ends: outside the bounds",
        _json(changed("/problem/bounds/theta", [-0.1, 0.1])),
        "/problem/final_state/theta",
    )
    yield BadDocument(
        "ends: unknown state", _json(changed("/problem/final_state/beta", 0)), "/problem/final_state/beta"
    )
    yield BadDocument(
        "ends: a state is missing", _json(without("/problem/initial_state/alpha")), "/problem/initial_state"
    )
    yield BadDocument(
        "ends: before the start", _json(changed("/problem/final_time", -1)), "/problem/final_time"
    )


def _keys() -> Iterator[BadDocument]:
    yield BadDocument("key: unknown at the top", _json(changed("/metod", {"name": "swcm"})), "/metod")
    yield BadDocument("key: unknown in the problem", _json(changed("/problem/bound", {})), "/problem/bound")
    yield BadDocument("key: unknown in the model", _json(changed(f"{_MODEL}/masses", [])), f"{_MODEL}/masses")
    yield BadDocument("key: unknown in the method", _json(changed("/method/nodes", 40)), "/method/nodes")
    yield BadDocument("key: strange", _json(changed('/a~b"<script>', 1)), '/a~0b"<script>')
    yield BadDocument("key: no problem", _json(without("/problem")), "/problem")
    yield BadDocument("key: no model", _json(without("/problem/model")), "/problem/model")
    yield BadDocument("key: no objective", _json(without("/problem/objective")), "/problem/objective")
    yield BadDocument("key: empty objective", _json(changed("/problem/objective", {})), "/problem/objective")
    yield BadDocument("key: unknown method", _json(changed("/method", {"name": "swmc"})), "/method/name")
    yield BadDocument("key: method without a name", _json(changed("/method", {"J": 4})), "/method/name")
    yield BadDocument(
        "key: unknown kind of model", _json(changed(f"{_MODEL}/kind", "quantum")), f"{_MODEL}/kind"
    )
    yield BadDocument(
        "key: a plant is not optimised",
        _json(changed(_MODEL, {"kind": "library", "name": "edt_plant"})),
        f"{_MODEL}/name",
    )
    for parameter, value in {"degree": 14, "epoch": 1e6, "m1": -1}.items():
        yield BadDocument(
            f"key: {parameter} of a library model outside its interval",
            _json(changed(_MODEL, {"kind": "library", "name": "edt", "parameters": {parameter: value}})),
            f"{_MODEL}/parameters/{parameter}",
        )
    yield BadDocument(
        "key: unknown library model",
        _json(changed(_MODEL, {"kind": "library", "name": "warp_drive"})),
        f"{_MODEL}/name",
    )
    yield BadDocument(
        "key: reserved name", _json(changed(f"{_MODEL}/parameters/pi", 3)), f"{_MODEL}/parameters/pi"
    )
    yield BadDocument(
        "key: clash with a velocity",
        _json(changed(f"{_MODEL}/parameters/theta_dot", 3)),
        f"{_MODEL}/parameters/theta_dot",
    )
    yield BadDocument(
        "key: the same coordinate twice",
        _json(changed(f"{_MODEL}/coordinates", ["theta", "theta"])),
        f"{_MODEL}/coordinates/1",
    )
    yield BadDocument("text: lone surrogate", _text('"slew"', '"\\ud800"'), "/tags/0")


def _growing_definitions() -> Iterator[tuple[str, str]]:
    """Definitions each of which has three times the operations of the one before."""
    before = "k"
    for number in range(12):
        yield f"d{number}", f"{before} + {before}*{before}"
        before = f"d{number}"


def _limits() -> Iterator[BadDocument]:
    for name, pointer, value in (
        ("N of swcm", "/method/J", 20),
        ("N of swcm, beyond all floats", "/method/J", 10**9),
        ("N of gpm", "/method", {"name": "gpm", "nodes": 513}),
        ("N of gpm in all", "/method", {"name": "gpm", "nodes": 512, "segments": 17}),
        ("N of hermite_simpson", "/method", {"name": "hermite_simpson", "intervals": 40_000}),
        ("samples", "/output/samples", 20_002),
        ("seconds", "/options/max_seconds", 3_601),
        ("name", "/name", "x" * 201),
        ("tags", "/tags", [str(number) for number in range(21)]),
        ("tag", "/tags/0", "x" * 65),
        ("guess", "/problem/guess", {"controls": {"T": [0.0] * 8_196}}),
        ("starts", "/options/starts", 65),
        ("level of swcm", "/method", {"name": "swcm", "adaptive": {"tolerance": 1e-6, "max_level": 21}}),
        ("characters", f"{_MODEL}/stiffness/1/1", "k" + " " * 4096),
        ("levels of an expression", f"{_MODEL}/stiffness/1/1", "(" * 65 + "k" + ")" * 65),
        ("operations", f"{_MODEL}/stiffness/1/1", "k" + "+k" * 2001),
        ("operations written out", f"{_MODEL}/definitions", dict(_growing_definitions())),
    ):
        where = {
            "N of gpm": "/method/nodes",
            "N of gpm in all": "/method/segments",
            "N of hermite_simpson": "/method/intervals",
            "guess": "/problem/guess/controls/T",
            "level of swcm": "/method/adaptive/max_level",
            "operations written out": f"{_MODEL}/definitions/d10",
        }.get(name, pointer)
        yield BadDocument(f"limit: {name}", _json(changed(pointer, value)), where, "limit")
    many = [f"x{number}" for number in range(65)]
    document = changed(
        _MODEL,
        {"kind": "first_order", "states": many, "controls": ["T"], "dynamics": dict.fromkeys(many, "T")},
    )
    document["problem"]["initial_state"] = {"*": 0}
    document["problem"]["final_state"] = {}
    yield BadDocument("limit: states", _json(document), f"{_MODEL}/states", "limit")
    document = changed(f"{_MODEL}/controls", [f"u{number}" for number in range(33)])
    document["problem"]["model"]["input"] = [[1] * 33, [0] * 33]
    document["problem"]["bounds"] = {}
    yield BadDocument("limit: controls", _json(document), f"{_MODEL}/controls", "limit")


def _unsupported() -> Iterator[BadDocument]:
    document = changed("/problem/phases", [{"name": "first"}]) | {"method": {"name": "ga"}}
    yield BadDocument("unsupported: phases", _json(document), "/method/name", "unsupported")


def _genetic() -> Iterator[BadDocument]:
    for key, value, kind in (
        ("wavelet", "db1", "invalid"),
        ("wavelet", "haar", "invalid"),
        ("wavelet", 2, "invalid"),
        ("boundary", "wrapped", "invalid"),
        ("scaling_functions", 0, "invalid"),
        ("scaling_functions", 4.5, "invalid"),
        ("scaling_functions", 5_000, "limit"),
        ("wavelet_levels", 12, "limit"),
        ("population", 1, "invalid"),
        ("population", 10_001, "limit"),
        ("generations", 0, "invalid"),
        ("generations", 2_100_000, "limit"),
        ("crossover_probability", 1.1, "limit"),
        ("mutation_probability", -0.1, "invalid"),
        ("mutation_sigma", -1, "invalid"),
        ("mutation_sigma", None, "invalid"),
        ("elite", 49, "invalid"),
        ("penalty", -1, "invalid"),
        ("seed", -1, "invalid"),
        ("seed", 2**32, "limit"),
        ("variant", "paper", "invalid"),
        ("polish", True, "invalid"),
        ("polish", 0, "invalid"),
        ("polish", "collocation", "invalid"),
        ("refine", "switching", "invalid"),
        ("crossover", 0.9, "invalid"),
    ):
        document = _json(changed("/method", {"name": "ga", key: value}))
        yield BadDocument(f"ga: {key} {value}", document, f"/method/{key}", kind)
    for name, method, place in (
        ("too few on the interval", {"scaling_functions": 2}, "scaling_functions"),
        ("too smooth for the interval", {"wavelet": "db5", "scaling_functions": 20}, "wavelet"),
    ):
        document = _json(changed("/method", {"name": "ga", "boundary": "interval", **method}))
        yield BadDocument(f"ga: {name}", document, f"/method/{place}")


def _webhooks() -> Iterator[BadDocument]:
    for name, url in {
        "another scheme": "ftp://example.org/",
        "no scheme": "example.org",
        "no host": "https:///told",
        "a user": "https://me:secret@example.org/",
        "a port": "https://example.org:99999/",
        "a line": "https://example.org/\r\nHost: other",
        "a number": 3,
    }.items():
        yield BadDocument(f"webhook: {name}", _json(changed("/webhook", {"url": url})), "/webhook/url")
    yield BadDocument("webhook: no address", _json(changed("/webhook", {})), "/webhook/url")
    yield BadDocument("webhook: a text", _json(changed("/webhook", "https://example.org/")), "/webhook")


def _turns() -> Iterator[BadDocument]:
    for pointer, values in {
        "/priority": ("urgent", None, 1, ["high"]),
        "/deadline_seconds": (0, -5, "soon", [60], True),
        "/reuse": ("yes", 1, {}),
    }.items():
        for value in values:
            yield BadDocument(f"turn: {pointer[1:]} {value}", _json(changed(pointer, value)), pointer)
    yield BadDocument(
        "limit: deadline", _json(changed("/deadline_seconds", 1e9)), "/deadline_seconds", "limit"
    )


def _piecewise() -> Iterator[BadDocument]:
    good: dict[str, Any] = {"name": "piecewise", "segments": {"by": "time", "length": 5}}
    other = {"kind": "first_order", "states": ["x"], "controls": ["T"], "dynamics": {"x": "T"}}
    for name, change, place in (
        ("no segments", {"segments": None}, "/segments"),
        ("a length of nothing", {"segments": {"by": "time", "length": 0}}, "/segments/length"),
        ("both length and count", {"segments": {"by": "time", "length": 5, "count": 2}}, "/segments/count"),
        ("by a control", {"segments": {"by": "T", "count": 2}}, "/segments/by"),
        ("by a state that goes nowhere", {"segments": {"by": "alpha", "count": 2}}, "/segments/by"),
        ("half a node", {"nodes": 2.5}, "/nodes"),
        ("another scheme", {"scheme": "greedy"}, "/scheme"),
        ("to the end of an unknown time", {"lookahead": "end"}, "/lookahead"),
        ("a stop of nothing", {"stop": {"expression": "theta", "bounds": 0}}, "/stop/expression"),
        ("a stop at the start", {"stop": {"expression": "theta_f + tf", "bounds": [None, 1]}}, "/stop"),
        ("a weight of a control among states", {"tracking": {"Q": {"T": 1}}}, "/tracking/Q/T"),
        ("crossed limits", {"tracking": {"limits": {"T": [1, -1]}}}, "/tracking/limits/T"),
        ("a negative margin", {"margins": {"theta": -1}}, "/margins/theta"),
        ("a plant that is a list", {"plant": []}, "/plant"),
        ("a plant without a model", {"plant": {"observe": {}}}, "/plant/model"),
        ("an unknown plant", {"plant": {"model": {"kind": "library", "name": "moon"}}}, "/plant/model/name"),
        ("an unseen state", {"plant": {"model": other, "start": {"x": "theta"}}}, "/plant/observe"),
        (
            "a plant of other controls",
            {"plant": {"model": other | {"controls": ["u"]}}},
            "/plant/model/controls",
        ),
        (
            "code as a view",
            {"plant": {"model": other, "observe": {"theta": "x.real"}}},
            "/plant/observe/theta",
        ),
    ):
        method = {key: value for key, value in {**good, **change}.items() if value is not None}
        yield BadDocument(f"piecewise: {name}", _json(changed("/method", method)), f"/method{place}")
    for name, change, place in (
        ("too many segments", {"segments": {"by": "theta", "count": 1e6}}, "/segments/count"),
        ("too short segments", {"segments": {"by": "time", "length": 1e-9}}, "/segments/length"),
        ("too many nodes", {"nodes": 1000}, "/nodes"),
    ):
        yield BadDocument(
            f"piecewise: {name}", _json(changed("/method", {**good, **change})), f"/method{place}", "limit"
        )


def _broken() -> Iterator[BadDocument]:
    good = json.dumps(FLEXIBLE_SPACECRAFT).encode()
    for name, raw in {
        "empty": b"",
        "blank": b" \n ",
        "cut off": good[:-20],
        "two documents": good + good,
        "trailing comma": b'{"problem": {},}',
        "single quotes": b"{'problem': {}}",
        "comment": b'{"problem": {} /* none */}',
        "not UTF-8": b'{"name": "\xff\xfe"}',
        "UTF-16": good.decode().encode("utf-16"),
        "not JSON at all": b"problem: {model: 1}",
    }.items():
        yield BadDocument(f"broken: {name}", raw, None)
    for name, raw in {
        "100,000 nested lists": b"[" * 100_000 + b"]" * 100_000,
        "100,000 nested objects": b'{"a":' * 100_000 + b"1" + b"}" * 100_000,
        "65 nested lists": json.dumps(changed("/metadata", {}))
        .encode()
        .replace(b"{}", b"[" * 65 + b"]" * 65),
    }.items():
        yield BadDocument(f"broken: {name}", raw, None, "limit")
    yield BadDocument("broken: duplicate key", _text('"schema": 1', '"schema": 1, "schema": 1'), None)
    yield BadDocument("broken: duplicate key inside", _text('"J": 4', '"J": 4, "J": 5'), None)
    yield BadDocument("broken: a list", b"[]", "")
    yield BadDocument("broken: null", b"null", "")
    yield BadDocument("broken: a number", b"3", "")
    yield BadDocument("broken: a text", b'"problem"', "")


def _json(document: dict[str, Any]) -> bytes:
    return json.dumps(document).encode()


BAD_DOCUMENTS: tuple[BadDocument, ...] = (
    *_expressions(),
    *_numbers(),
    *_shapes(),
    *_ends(),
    *_keys(),
    *_limits(),
    *_unsupported(),
    *_genetic(),
    *_webhooks(),
    *_turns(),
    *_piecewise(),
    *_broken(),
)
