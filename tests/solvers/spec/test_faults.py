"""Every kind of mistake that a document can make: found, at its exact pointer, with a word of advice."""

from __future__ import annotations

from typing import Any

import pytest

from solvers.errors import Fault
from tests.solvers.spec.editing import FIRST_ORDER, LIBRARY, REMOVED, edited, faults_of

MODEL = "/problem/model"
Row = tuple[dict[str, Any], str, str]


def only_fault(changes: dict[str, Any], base: dict[str, Any] | None = None) -> Fault:
    document = edited(changes) if base is None else edited(changes, base)
    faults = faults_of(document)
    assert len(faults) == 1, faults
    return faults[0]


STRUCTURE: list[Row] = [
    ({"/metod": {}}, "/metod", "did you mean 'method'"),
    ({"/a~1b~0c": 1}, "/a~1b~0c", "unknown key"),
    ({"/problem/bound": {}}, "/problem/bound", "did you mean 'bounds'"),
    ({f"{MODEL}/masses": []}, f"{MODEL}/masses", "did you mean 'mass'"),
    ({f"{MODEL}/dynamics": {}}, f"{MODEL}/dynamics", "unknown key"),
    ({"/problem/objective/terminl": "tf"}, "/problem/objective/terminl", "did you mean 'terminal'"),
    ({"/problem/guess/finaltime": 3}, "/problem/guess/finaltime", "did you mean 'final_time'"),
    (
        {"/problem/path_constraints": [{"expresion": "T", "expression": "T", "bounds": 0}]},
        "/problem/path_constraints/0/expresion",
        "did you mean 'expression'",
    ),
    (
        {"/problem/boundary_constraints": [{"expression": "tf"}]},
        "/problem/boundary_constraints/0/bounds",
        "required",
    ),
    ({"/method/nodes": 40}, "/method/nodes", "unknown key"),
    ({"/options/tolerence": 1}, "/options/tolerence", "did you mean 'tolerance'"),
    ({"/options/verification/bounds": 1}, "/options/verification/bounds", "did you mean 'bound'"),
    ({"/output/sample": 1}, "/output/sample", "did you mean 'samples'"),
    ({"/problem": REMOVED}, "/problem", "required"),
    ({MODEL: REMOVED}, MODEL, "required"),
    ({f"{MODEL}/mass": REMOVED}, f"{MODEL}/mass", "required"),
    ({f"{MODEL}/input": REMOVED}, f"{MODEL}/input", "required"),
    ({f"{MODEL}/coordinates": REMOVED}, f"{MODEL}/coordinates", "required"),
    ({f"{MODEL}/controls": REMOVED}, f"{MODEL}/controls", "required"),
    ({"/problem/final_time": REMOVED}, "/problem/final_time", "required"),
    ({"/problem/initial_state": REMOVED}, "/problem/initial_state", "required"),
    ({"/problem/objective": REMOVED}, "/problem/objective", "required"),
    ({"/problem": []}, "/problem", "must be an object, not a list"),
    ({"/problem": None}, "/problem", "must be an object, not null"),
    ({MODEL: "mechanical"}, MODEL, "must be an object, not text"),
    ({"/problem/objective": "tf"}, "/problem/objective", "must be an object, not text"),
    ({"/problem/path_constraints": {}}, "/problem/path_constraints", "must be a list, not an object"),
    ({"/problem/path_constraints": [3]}, "/problem/path_constraints/0", "must be an object, not a number"),
    ({"/problem/bounds": [1]}, "/problem/bounds", "must be an object"),
    ({"/problem/units": []}, "/problem/units", "must be an object"),
    ({"/problem/units": {"T": 3}}, "/problem/units/T", "must be text"),
    ({"/name": 3}, "/name", "must be text, not a number"),
    ({"/notes": None}, "/notes", "must be text, not null"),
    ({"/tags": "slew"}, "/tags", "must be a list, not text"),
    ({"/tags": ["a", 1]}, "/tags/1", "must be text"),
    ({"/metadata": []}, "/metadata", "must be an object"),
    ({"/reference": 25.9}, "/reference", "must be an object"),
    ({"/schema": 2}, "/schema", "must be 1"),
    ({"/schema": "1"}, "/schema", "must be 1"),
    ({"/schema": True}, "/schema", "must be 1"),
    ({"/priority": "urgent"}, "/priority", "'normal'"),
    ({"/reuse": "yes"}, "/reuse", "true or false"),
    ({"/priority": None}, "/priority", "'high'"),
    ({"/priority": ["high"]}, "/priority", "'high'"),
    ({"/deadline_seconds": 0}, "/deadline_seconds", "greater than 0"),
    ({"/deadline_seconds": "soon"}, "/deadline_seconds", "soon"),
    ({f"{MODEL}/kind": "quantum"}, f"{MODEL}/kind", "mechanical, modal, first_order, library"),
    ({f"{MODEL}/kind": "mechanic"}, f"{MODEL}/kind", "did you mean 'mechanical'"),
    ({f"{MODEL}/kind": REMOVED}, f"{MODEL}/kind", "required"),
    ({f"{MODEL}/kind": ["mechanical"]}, f"{MODEL}/kind", "not a list"),
    ({"/method": {"name": "swmc"}}, "/method/name", "did you mean 'swcm'"),
    ({"/method": {"name": "euler"}}, "/method/name", "auto, swcm, gpm, hermite_simpson"),
    ({"/method": {"J": 4}}, "/method/name", "required"),
    ({"/method": "swcm"}, "/method", "must be an object, not text"),
]

NUMBERS: list[Row] = [
    ({f"{MODEL}/parameters/Jb": True}, f"{MODEL}/parameters/Jb", "not true"),
    ({f"{MODEL}/parameters/Jb": None}, f"{MODEL}/parameters/Jb", "not null"),
    ({f"{MODEL}/parameters/Jb": [440]}, f"{MODEL}/parameters/Jb", "not a list"),
    ({f"{MODEL}/parameters/Jb": "1/0"}, f"{MODEL}/parameters/Jb", "finite"),
    ({f"{MODEL}/parameters/Jb": "(-8)^(1/3)"}, f"{MODEL}/parameters/Jb", "finite"),
    ({f"{MODEL}/parameters/Jb": "exp(1000)"}, f"{MODEL}/parameters/Jb", "finite"),
    ({f"{MODEL}/parameters/R": "k/40"}, f"{MODEL}/parameters/R", "'k' comes later"),
    ({f"{MODEL}/parameters/R": "Jc"}, f"{MODEL}/parameters/R", "did you mean 'Jb'"),
    ({f"{MODEL}/parameters/R": "R"}, f"{MODEL}/parameters/R", "comes later"),
    ({"/problem/initial_time": None}, "/problem/initial_time", "not null"),
    ({"/problem/final_time": None}, "/problem/final_time", "not null"),
    ({"/problem/final_time": "theta"}, "/problem/final_time", "parameters and constants"),
    ({"/problem/bounds/T": [0]}, "/problem/bounds/T", "not a list of 1"),
    ({"/problem/bounds/T": [-5, 0, 5]}, "/problem/bounds/T", "[lower, upper]"),
    ({"/problem/bounds/T": ["-x", 5]}, "/problem/bounds/T/0", "unknown name 'x'"),
    ({"/problem/bounds/T": [-5, {}]}, "/problem/bounds/T/1", "not an object"),
    ({"/problem/bounds/T": [True, 5]}, "/problem/bounds/T/0", "not true"),
    ({"/problem/bounds/T": ["-T", 5]}, "/problem/bounds/T/0", "'T' cannot be used here"),
    ({"/problem/final_state/theta": "30 deg"}, "/problem/final_state/theta", "operator is missing"),
    ({"/problem/guess/final_time": "30*s"}, "/problem/guess/final_time", "unknown name 's'"),
    ({"/method/L": 4}, "/method/L", "at least 5"),
    ({"/method/L": 5.5}, "/method/L", "whole number"),
    ({"/method/L": "k/15"}, "/method/L", "whole number, not 6.66667"),
    ({"/method/L": "eight"}, "/method/L", "unknown name 'eight'"),
    ({"/output/samples": "20*m + R"}, "/output/samples", "whole number, not 202.5"),
    ({"/problem/bounds/T": {}}, "/problem/bounds/T", "[lower, upper] (a side may be null), not an object"),
    ({f"{MODEL}/parameters/R": "alpha"}, f"{MODEL}/parameters/R", "'alpha' cannot be used here"),
    ({"/problem/final_state/theta": "PI/6"}, "/problem/final_state/theta", "did you mean 'pi'?"),
    ({f"{MODEL}/mass/0/1": "1/(k - 100)"}, f"{MODEL}/mass/0/1", "entry 0, 1 is inf"),
    ({f"{MODEL}/mass": {"diag": [1, "log(0)"]}}, f"{MODEL}/mass/diag/1", "entry 1, 1 is -inf"),
    (
        {f"{MODEL}/mass": {"entries": [[0, 0, 1], [1, 0, "1/0"], [1, 1, 1]], "symmetric": True}},
        f"{MODEL}/mass/entries/1/2",
        "entry 0, 1 is inf",
    ),
    (
        {"/method": {"name": "gpm", "adaptive": {"max_level": 4}}},
        "/method/adaptive/max_level",
        "unknown key 'max_level'",
    ),
    ({"/method/J": True}, "/method/J", "whole number, not true"),
    ({"/method/J": -1}, "/method/J", "at least 0"),
    ({"/method": {"name": "gpm", "nodes": 0}}, "/method/nodes", "at least 1"),
    ({"/method": {"name": "hermite_simpson", "intervals": 0}}, "/method/intervals", "at least 1"),
    ({"/method": {"name": "auto", "accuracy": 0}}, "/method/accuracy", "greater than 0"),
    ({"/options/tolerance": 0}, "/options/tolerance", "greater than 0"),
    ({"/options/tolerance": "tight"}, "/options/tolerance", "unknown name 'tight'"),
    ({"/options/max_seconds": -1}, "/options/max_seconds", "greater than 0"),
    ({"/options/max_iterations": -1}, "/options/max_iterations", "at least 0"),
    ({"/options/starts": 0}, "/options/starts", "at least 1"),
    ({"/options/verification": {"path": 0}}, "/options/verification/path", "greater than 0"),
    ({"/output/samples": 1}, "/output/samples", "at least 2"),
]

EXPRESSIONS: list[Row] = [
    ({f"{MODEL}/mass/0/0": "Jc + 2*m"}, f"{MODEL}/mass/0/0", "unknown name 'Jc'; did you mean 'Jb'?"),
    ({f"{MODEL}/mass/0/0": "440 + Jc"}, f"{MODEL}/mass/0/0", "(at character 7)"),
    ({f"{MODEL}/damping/1/0": "theta_dott"}, f"{MODEL}/damping/1/0", "did you mean 'theta_dot'"),
    ({f"{MODEL}/stiffness/1/1": "2*k*"}, f"{MODEL}/stiffness/1/1", "value is expected"),
    ({f"{MODEL}/input/0/0": {}}, f"{MODEL}/input/0/0", "number or an expression, not an object"),
    ({f"{MODEL}/force": ["theta_ddot", 0]}, f"{MODEL}/force/0", "'theta_ddot' cannot be used here"),
    ({f"{MODEL}/force": [0, "tf"]}, f"{MODEL}/force/1", "'tf' cannot be used here"),
    ({"/problem/objective/terminal": "theta"}, "/problem/objective/terminal", "<state>_f"),
    ({"/problem/objective/terminal": "t"}, "/problem/objective/terminal", "'t' cannot be used here"),
    ({"/problem/objective/running": "theta_f"}, "/problem/objective/running", "along the trajectory"),
    ({"/problem/objective/running": True}, "/problem/objective/running", "not true"),
    (
        {"/problem/path_constraints": [{"expression": "alpa", "bounds": 0}]},
        "/problem/path_constraints/0/expression",
        "did you mean 'alpha'",
    ),
    (
        {"/problem/path_constraints": [{"expression": "alpha", "bounds": [2, 1]}]},
        "/problem/path_constraints/0/bounds",
        "crossed",
    ),
    (
        {"/problem/boundary_constraints": [{"expression": "alpha", "bounds": 0}]},
        "/problem/boundary_constraints/0/expression",
        "'alpha' cannot be used here",
    ),
]

SHAPES: list[Row] = [
    ({f"{MODEL}/mass": [[1, 0]]}, f"{MODEL}/mass", "2 in all, not 1"),
    ({f"{MODEL}/mass": []}, f"{MODEL}/mass", "2 in all, not 0"),
    ({f"{MODEL}/mass": [[1, 0], [0]]}, f"{MODEL}/mass/1", "2 in all, not 1"),
    ({f"{MODEL}/mass": [[1, 0], 1]}, f"{MODEL}/mass/1", "a row must be a list"),
    ({f"{MODEL}/mass": 3}, f"{MODEL}/mass", "must be a list, not a number"),
    ({f"{MODEL}/damping": [[0, 0], [0, 0], [0, 0]]}, f"{MODEL}/damping", "2 in all, not 3"),
    ({f"{MODEL}/stiffness/0": [0, 0, 0]}, f"{MODEL}/stiffness/0", "2 in all, not 3"),
    ({f"{MODEL}/input": [[1]]}, f"{MODEL}/input", "2 in all, not 1"),
    ({f"{MODEL}/input/1": [0, 0]}, f"{MODEL}/input/1", "each control, 1 in all, not 2"),
    ({f"{MODEL}/force": [0]}, f"{MODEL}/force", "2 in all, not 1"),
    ({f"{MODEL}/force": "T"}, f"{MODEL}/force", "must be a list"),
    ({f"{MODEL}/mass": [[1, 1], [1, 1]]}, f"{MODEL}/mass", "singular"),
    ({f"{MODEL}/mass": [[0, 0], [0, 1]]}, f"{MODEL}/mass", "singular"),
    ({f"{MODEL}/mass/0": ["sin(theta)", 0]}, f"{MODEL}/mass", "singular"),
    ({f"{MODEL}/mass/0/0": "1/alpha"}, f"{MODEL}/mass/0/0", "not finite at the start: entry 0, 0"),
]

NAMES: list[Row] = [
    ({"/problem/initial_state/beta": 0}, "/problem/initial_state/beta", "unknown state 'beta'"),
    ({"/problem/final_state/alfa": 0}, "/problem/final_state/alfa", "did you mean 'alpha'"),
    ({"/problem/final_state/T": 0}, "/problem/final_state/T", "'T' is a control"),
    ({"/problem/bounds/*": 0}, "/problem/bounds/*", "unknown state or control '*'"),
    ({"/problem/bounds/theta_dt": 0}, "/problem/bounds/theta_dt", "did you mean 'theta_dot'"),
    ({"/problem/units/tehta": "rad"}, "/problem/units/tehta", "did you mean 'theta'"),
    ({"/problem/guess/states": {"alfa": [0]}}, "/problem/guess/states/alfa", "did you mean 'alpha'"),
    ({"/problem/guess/controls": {"theta": [0]}}, "/problem/guess/controls/theta", "unknown control"),
    ({"/problem/initial_state/alpha": REMOVED}, "/problem/initial_state", "'alpha' is missing"),
    ({f"{MODEL}/parameters/pi": 3}, f"{MODEL}/parameters/pi", "reserved"),
    ({f"{MODEL}/parameters/t": 3}, f"{MODEL}/parameters/t", "reserved"),
    ({f"{MODEL}/parameters/atan2": 3}, f"{MODEL}/parameters/atan2", "reserved"),
    ({f"{MODEL}/parameters/alpha_dot": 3}, f"{MODEL}/parameters/alpha_dot", "generated for 'alpha'"),
    ({f"{MODEL}/parameters/alpha_ddot": 3}, f"{MODEL}/parameters/alpha_ddot", "generated for 'alpha'"),
    ({f"{MODEL}/parameters/T_dot": 3}, f"{MODEL}/parameters/T_dot", "generated for 'T'"),
    ({f"{MODEL}/parameters/T_0": 3}, f"{MODEL}/parameters/T_0", "generated for 'T'"),
    ({f"{MODEL}/parameters/alpha_dot_f": 3}, f"{MODEL}/parameters/alpha_dot_f", "generated for 'alpha_dot'"),
    ({f"{MODEL}/parameters/theta": 3}, f"{MODEL}/parameters/theta", "already taken by a coordinate"),
    ({f"{MODEL}/parameters/a b": 3}, f"{MODEL}/parameters/a b", "not a name"),
    ({f"{MODEL}/parameters/_a": 3}, f"{MODEL}/parameters/_a", "not a name"),
    ({f"{MODEL}/parameters/": 3}, f"{MODEL}/parameters/", "not a name"),
    ({f"{MODEL}/parameters/a\n": 3}, f"{MODEL}/parameters/a\n", "not a name"),
    ({f"{MODEL}/parameters/µ": 3}, f"{MODEL}/parameters/µ", "not a name"),
    ({f"{MODEL}/coordinates": ["theta", 3]}, f"{MODEL}/coordinates/1", "must be text"),
    ({f"{MODEL}/coordinates": "theta"}, f"{MODEL}/coordinates", "must be a list"),
]

ENDS: list[Row] = [
    ({"/problem/bounds/T": [5, -5]}, "/problem/bounds/T", "crossed"),
    ({"/problem/bounds/T": ["k", "-k"]}, "/problem/bounds/T", "100 is above the upper side -100"),
    ({"/problem/final_time": [100, 1]}, "/problem/final_time", "crossed"),
    ({"/problem/initial_state/theta": [1, -1]}, "/problem/initial_state/theta", "crossed"),
    ({"/problem/bounds/theta": [-0.1, 0.1]}, "/problem/final_state/theta", "outside its bounds [-0.1, 0.1]"),
    ({"/problem/bounds/theta": [None, 0.5]}, "/problem/final_state/theta", "outside its bounds [-inf, 0.5]"),
    ({"/problem/final_time": -1}, "/problem/final_time", "not after the initial time"),
    ({"/problem/final_time": 0}, "/problem/final_time", "not after the initial time"),
    (
        {"/problem/initial_time": 101, "/problem/guess": {}},
        "/problem/final_time",
        "not after the initial time",
    ),
    ({"/problem/guess/final_time": 0}, "/problem/guess/final_time", "not after the initial time"),
    ({"/problem/guess/states": {"theta": []}}, "/problem/guess/states/theta", "at least one value"),
    ({"/problem/guess/states": {"theta": 1}}, "/problem/guess/states/theta", "must be a list"),
    ({"/problem/guess/states": {"theta": [0, "x"]}}, "/problem/guess/states/theta/1", "unknown name 'x'"),
    (
        {"/problem/guess/states": {"theta": {"times": [0, 1], "values": [0]}}},
        "/problem/guess/states/theta",
        "2 times for 1 values",
    ),
    (
        {"/problem/guess/states": {"theta": {"times": [0, 0], "values": [0, 1]}}},
        "/problem/guess/states/theta/times/1",
        "ascend",
    ),
    ({"/problem/guess/states": {"theta": {"values": [0]}}}, "/problem/guess/states/theta", "both 'times'"),
    (
        {"/problem/guess/states": {"theta": {"times": [0], "values": [0], "x": 1}}},
        "/problem/guess/states/theta/x",
        "unknown key",
    ),
    ({"/problem/guess/times": [2, 1]}, "/problem/guess/times/1", "ascend"),
    (
        {"/problem/guess/times": [0, 1], "/problem/guess/controls": {"T": [1]}},
        "/problem/guess/controls/T",
        "2 times for 1 values",
    ),
    ({"/problem/objective": {}}, "/problem/objective", "at least one of"),
    ({"/problem/objective": {"terminal": None}}, "/problem/objective", "at least one of"),
]


@pytest.mark.parametrize(
    ("changes", "pointer", "word"),
    [
        pytest.param(*row, id=f"{kind}-{row[1]}-{row[2]}")
        for kind, rows in {
            "structure": STRUCTURE,
            "numbers": NUMBERS,
            "expressions": EXPRESSIONS,
            "shapes": SHAPES,
            "names": NAMES,
            "ends": ENDS,
        }.items()
        for row in rows
    ],
)
def test_mistake(changes: dict[str, Any], pointer: str, word: str) -> None:
    fault = only_fault(changes)
    assert (fault.pointer, fault.type) == (pointer, "invalid")
    assert word in fault.detail


LIMITS: list[Row] = [
    ({"/name": "x" * 201}, "/name", "200 characters"),
    ({"/tags": ["x"] * 21}, "/tags", "20 tags"),
    ({"/tags/0": "x" * 65}, "/tags/0", "64 characters"),
    ({"/method/J": 20}, "/method/J", "65,539 nodes"),
    ({"/method/J": 10**9}, "/method/J", "65,539 nodes"),
    ({"/method/J": 14}, "/method/J", "131,075 nodes, at most 65,539"),
    ({"/method/L": 10**6}, "/method/L", "65,539 nodes"),
    ({"/method": {"name": "gpm", "nodes": 513}}, "/method/nodes", "512 nodes a segment"),
    ({"/method": {"name": "gpm", "nodes": 512, "segments": 17}}, "/method/segments", "8,192"),
    ({"/method": {"name": "hermite_simpson", "intervals": 32_770}}, "/method/intervals", "65,539 nodes"),
    ({"/output/samples": 20_002}, "/output/samples", "20,001 samples"),
    ({"/options/max_seconds": 3601}, "/options/max_seconds", "3,600 s"),
    ({"/deadline_seconds": 1e9}, "/deadline_seconds", "2,592,000 s"),
    ({"/options/starts": 65}, "/options/starts", "64 starts"),
    ({"/problem/guess/controls": {"T": [0.0] * 8196}}, "/problem/guess/controls/T", "8,195 values"),
    ({"/problem/guess/times": list(range(8196))}, "/problem/guess/times", "8,195 values"),
    ({f"{MODEL}/mass/0/0": "-" * 100_000 + "1"}, f"{MODEL}/mass/0/0", "4,096 characters"),
    ({f"{MODEL}/mass/0/0": "(" * 65 + "1" + ")" * 65}, f"{MODEL}/mass/0/0", "64 levels"),
    ({f"{MODEL}/mass/0/0": "1" + "+1" * 2040}, f"{MODEL}/mass/0/0", "2,000 operations"),
    ({f"{MODEL}/parameters/Jb": "1" + "+1" * 2040}, f"{MODEL}/parameters/Jb", "2,000 operations"),
    ({"/problem/bounds/T": ["-" * 65 + "1", 5]}, "/problem/bounds/T/0", "64 levels"),
    ({"/problem/units": {"T": "x" * 201}}, "/problem/units/T", "200 characters"),
    (
        {"/problem/path_constraints": [{"expression": 0, "bounds": 0}] * 1001},
        "/problem/path_constraints",
        "1,000 constraints",
    ),
]


@pytest.mark.parametrize(
    ("changes", "pointer", "word"), [pytest.param(*row, id=f"{row[1]}-{row[2]}") for row in LIMITS]
)
def test_limit(changes: dict[str, Any], pointer: str, word: str) -> None:
    fault = only_fault(changes)
    assert (fault.pointer, fault.type) == (pointer, "limit")
    assert fault.detail.startswith("limit: ")
    assert word in fault.detail


@pytest.mark.parametrize(
    "changes",
    [
        {"/name": "x" * 200, "/tags": ["x" * 64] * 20},
        {"/method": {"name": "swcm", "L": 8, "J": 13}},
        {"/method": {"name": "swcm", "L": 65_536, "J": 0}},
        {"/method": {"name": "swcm", "L": 8.0, "J": 0}},
        {"/method": {"name": "gpm", "nodes": 512, "segments": 16}},
        {"/method": {"name": "hermite_simpson", "intervals": 32_769}},
        {"/output/samples": 20_001, "/options/max_seconds": 3600},
        {"/problem/guess/controls": {"T": [0.0] * 8195}},
    ],
)
def test_limit_itself_is_allowed(changes: dict[str, Any]) -> None:
    assert faults_of(edited(changes)) == ()


def test_too_many_states_and_controls() -> None:
    many = [f"x{i}" for i in range(65)]
    changes = {f"{MODEL}/states": many, f"{MODEL}/dynamics": dict.fromkeys(many, 0)}
    changes["/problem/initial_state"] = {"*": 0}
    fault = only_fault(changes, FIRST_ORDER)
    assert (fault.pointer, fault.type) == (f"{MODEL}/states", "limit")
    assert "64 states" in fault.detail
    fault = faults_of(edited({f"{MODEL}/controls": ["u", *many[:32]]}, FIRST_ORDER))[0]
    assert (fault.pointer, fault.type) == (f"{MODEL}/controls", "limit")
    assert "32 controls" in fault.detail


UNSUPPORTED: list[tuple[dict[str, Any], str]] = [
    (
        {"/problem/initial_control": {"T": 0}, "/method/refine": "switching"},
        "/problem/initial_control/T",
    ),
    ({"/problem/final_control": {"T": 0}, "/method/refine": "switching"}, "/problem/final_control/T"),
    (
        {
            "/problem/path_constraints": [{"expression": "T", "bounds": 0, "during": [0, 0.5]}],
            "/method/refine": "switching",
        },
        "/problem/path_constraints/0/during",
    ),
]


@pytest.mark.parametrize(("changes", "pointer"), [pytest.param(*row, id=row[1]) for row in UNSUPPORTED])
def test_unsupported(changes: dict[str, Any], pointer: str) -> None:
    fault = only_fault(changes)
    assert (fault.pointer, fault.type) == (pointer, "unsupported")
    assert fault.detail.startswith("unsupported: ")
    assert "not in this version" in fault.detail


def test_what_asks_for_nothing_is_no_fault() -> None:
    changes = {
        "/problem/scenarios": None,
        "/problem/integrals": [],
        "/problem/control_rates": {},
        f"{MODEL}/definitions": {},
        "/method/adaptive": None,
        "/method/refine": None,
        "/reuse": False,
        "/priority": "normal",
        "/deadline_seconds": None,
        "/problem/path_constraints": [{"expression": "T", "bounds": [-5, 5], "during": [0, 1]}],
    }
    assert faults_of(edited(changes)) == ()


DYNAMICS: list[Row] = [
    ({f"{MODEL}/dynamics": {"x": "v"}}, f"{MODEL}/dynamics", "'v' has no expression"),
    ({f"{MODEL}/dynamics/w": 0}, f"{MODEL}/dynamics/w", "unknown state 'w'"),
    ({f"{MODEL}/dynamics/v": "u/mm"}, f"{MODEL}/dynamics/v", "did you mean 'm'"),
    ({f"{MODEL}/dynamics/v": None}, f"{MODEL}/dynamics/v", "not null"),
    ({f"{MODEL}/dynamics": ["v", "u"]}, f"{MODEL}/dynamics", "must be an object"),
    ({f"{MODEL}/dynamics": REMOVED}, f"{MODEL}/dynamics", "required"),
    ({f"{MODEL}/states": ["x", "v", "x"]}, f"{MODEL}/states/2", "already taken by a state"),
    ({f"{MODEL}/controls": ["v"]}, f"{MODEL}/controls/0", "already taken by a state"),
    ({f"{MODEL}/mass": [[1]]}, f"{MODEL}/mass", "unknown key"),
    ({"/problem/initial_state/v": REMOVED}, "/problem/initial_state", "'v' is missing"),
]


@pytest.mark.parametrize(
    ("changes", "pointer", "word"), [pytest.param(*row, id=f"{row[1]}-{row[2]}") for row in DYNAMICS]
)
def test_mistake_of_first_order_model(changes: dict[str, Any], pointer: str, word: str) -> None:
    fault = next(f for f in faults_of(edited(changes, FIRST_ORDER)) if f.pointer == pointer)
    assert word in fault.detail


LIBRARY_ROWS: list[Row] = [
    ({f"{MODEL}/name": "flexible_spacecaft"}, f"{MODEL}/name", "rigid_body, flexible_spacecraft"),
    ({f"{MODEL}/name": 3}, f"{MODEL}/name", "not a number"),
    ({f"{MODEL}/name": REMOVED}, f"{MODEL}/name", "required"),
    ({f"{MODEL}/parameters": {"jb": 1}}, f"{MODEL}/parameters/jb", "did you mean 'Jb'"),
    ({f"{MODEL}/parameters": {"Jb": "1/0"}}, f"{MODEL}/parameters/Jb", "finite"),
    ({f"{MODEL}/parameters": {"R": "k"}}, f"{MODEL}/parameters/R", "comes later"),
    ({f"{MODEL}/parameters": {"L": 0, "R": 0}}, MODEL, "singular"),
    ({f"{MODEL}/mass": [[1]]}, f"{MODEL}/mass", "unknown key"),
    ({"/problem/bounds": {"U": 1}}, "/problem/bounds/U", "unknown state or control"),
]


@pytest.mark.parametrize(
    ("changes", "pointer", "word"), [pytest.param(*row, id=f"{row[1]}-{row[2]}") for row in LIBRARY_ROWS]
)
def test_mistake_of_library_model(changes: dict[str, Any], pointer: str, word: str) -> None:
    fault = only_fault(changes, LIBRARY)
    assert fault.pointer == pointer
    assert word in fault.detail
