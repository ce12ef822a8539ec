"""clients/matlab/ondelette.m and the examples of docs/matlab.md, run by GNU Octave where it is installed."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDER, PAGE = ROOT / "clients" / "matlab", ROOT / "docs" / "matlab.md"
OCTAVE = shutil.which("octave-cli")

pytestmark = pytest.mark.skipif(
    OCTAVE is None or shutil.which("curl") is None, reason="needs GNU Octave and curl"
)

# Minimum times in closed form, 2 sqrt(m x_f / u), of three kinds of models; the case's own reference answer.
SESSION = """
at = {'Server', 'URL'};
FIRST
assert(result.success); assert(strcmp(result.status, 'converged'));
assert(abs(result.objective - 2) < 1e-5); assert(abs(result.states.x(end) - 1) < 1e-6);
assert(size(result.t), size(result.controls.u)); assert(abs(result.switching.u.times - 1) < 1e-4);

SECOND
assert(result.success); assert(numel(result.switching.T.times) == 3);

d.problem.model = struct('kind', 'mechanical', 'coordinates', 'x', 'controls', 'u', 'mass', 4, 'input', 1);
d.problem.initial_state = struct('x_', 0);
d.problem.final_state = struct('x', 1, 'x_dot', 0);
d.problem.outputs = struct('name', 'power', 'expression', 'u*x_dot');
r = ondelette(d, at{:});
assert(abs(r.objective - 4) < 1e-5); assert(abs(max(r.outputs.power) - 0.5) < 1e-2);

d.problem.model = struct('kind', 'modal', 'axes', 'x', 'controls', 'u', 'inertia', 4, 'input', 1, ...
  'modes', struct('name', 'p', 'frequency_hz', 3, 'damping', 0.005, 'coupling', 0.001), ...
  'mode_basis', 'constrained');
d.problem = rmfield(d.problem, 'outputs');
d.problem.final_state.p = NaN;
r = ondelette('result', ondelette('submit', d, at{:}), at{:});
assert(abs(r.objective - 4) < 1e-3);

c = jsondecode(ondelette('case', 'flexible_spacecraft', at{:}));
c.method.refine = 'switching';
r = ondelette(c, at{:});
assert(r.success); assert(abs(r.objective - 25.866100388133) < 1e-8);

d.problem.bounds.u = [1 -1];
try
  ondelette(d, at{:}); error('not refused');
catch refusal
  assert(any(strfind(refusal.message, '/problem/bounds/u: ')));
end
try
  ondelette(d, 'Server', 'http://127.0.0.1:9'); error('not refused');
catch refusal
  assert(strcmp(refusal.identifier, 'ondelette:unreachable'));
end
disp('all well');
"""


def test_structs_go_out_and_results_come_back(url: str) -> None:
    first, second = re.findall(r"^```matlab\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    # What is printed with a default address and drawn on a screen.
    first = first.replace("ondelette(d)", "ondelette(d, at{:})").replace("plot(", "cat(1, ")
    second = second.replace("('case', 'flexible_spacecraft'", "('case', 'flexible_spacecraft', at{:}")
    second = second.replace("'Timeout', 60", "'Timeout', 60, at{:}")
    code = SESSION.replace("FIRST", first).replace("SECOND", second).replace("URL", url)
    run = subprocess.run(
        [str(OCTAVE), "--quiet", "--path", str(FOLDER), "--eval", code],
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert "all well" in run.stdout, run.stdout + run.stderr
