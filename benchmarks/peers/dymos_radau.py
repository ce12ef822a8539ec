"""dymos: Radau collocation in segments of five points, total derivatives by colouring, SciPy's SLSQP.

pyOptSparse, through which dymos is commonly driven with IPOPT or SNOPT, is not in the package index.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable
from importlib.metadata import version

import dymos
import numpy as np
import openmdao.api as om
from contract import Answer, run, through_the_ends
from problems import MAX_ITERATIONS, TOLERANCE, Case

DEGREE = 5


class Rates(om.ExplicitComponent):
    """The model at every node, its partial derivatives by complex steps on the diagonal."""

    def initialize(self) -> None:
        """Declare the options that dymos passes on."""
        self.options.declare("num_nodes", types=int)
        self.options.declare("case", types=Case)

    def setup(self) -> None:
        """One input a state and control, one output a rate, and the running cost."""
        case, count = self.options["case"], self.options["num_nodes"]
        for name in (*case.states, *case.controls):
            self.add_input(name, shape=count)
        self.outputs_of = [*(f"{name}_rate" for name in case.states)]
        if "running" in case.objective:
            self.outputs_of.append("cost_rate")
        diagonal = np.arange(count)
        for output in self.outputs_of:
            self.add_output(output, shape=count)
            self.declare_partials(output, "*", rows=diagonal, cols=diagonal)

    def _values(self, inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        case = self.options["case"]
        states, controls = ([inputs[name] for name in names] for names in (case.states, case.controls))
        values = case.rates(states, controls, np)
        running = case.running(states, controls, np)
        return values if running is None else [*values, running]

    def compute(self, inputs: dict, outputs: dict) -> None:
        """Rates at the nodes."""
        for name, value in zip(self.outputs_of, self._values(inputs), strict=True):
            outputs[name] = value

    def compute_partials(self, inputs: dict, partials: dict) -> None:
        """By complex steps, one an input, all nodes at once."""
        case = self.options["case"]
        plain = {name: np.array(inputs[name], complex) for name in (*case.states, *case.controls)}
        for name, value in plain.items():
            stepped = self._values({**plain, name: value + 1e-30j})
            for output, result in zip(self.outputs_of, stepped, strict=True):
                partials[output, name] = np.imag(result + 0 * value) / 1e-30


def build(case: Case, points: int, variant: str) -> Callable[[], Answer]:
    """One phase without continuity of the control between segments, as in the other Radau methods."""
    segments = round(points / DEGREE)
    problem = om.Problem(reports=False)
    problem.driver = om.ScipyOptimizeDriver(
        optimizer="SLSQP", tol=TOLERANCE, maxiter=MAX_ITERATIONS, disp=False
    )
    problem.driver.declare_coloring(show_summary=False, show_sparsity=False)
    trajectory = problem.model.add_subsystem("traj", dymos.Trajectory())
    phase = dymos.Phase(
        ode_class=Rates,
        ode_init_kwargs={"case": case},
        transcription=dymos.Radau(num_segments=segments, order=DEGREE, compressed=True),
    )
    trajectory.add_phase("phase", phase)
    if case.free_time:
        phase.set_time_options(fix_initial=True, duration_bounds=case.final_time)
    else:
        phase.set_time_options(fix_initial=True, fix_duration=True)

    def bounds(name: str) -> dict[str, float]:
        low, high = case.bounds[name]
        return ({"lower": low} if np.isfinite(low) else {}) | ({"upper": high} if np.isfinite(high) else {})

    for name in case.states:
        phase.add_state(
            name,
            rate_source=f"{name}_rate",
            targets=[name],
            fix_initial=name in case.initial,
            fix_final=name in case.final,
            **bounds(name),
        )
    for name in case.controls:
        phase.add_control(name, targets=[name], continuity=False, rate_continuity=False, **bounds(name))
    if "running" in case.objective:
        phase.add_state("cost", rate_source="cost_rate", fix_initial=True)
        phase.add_objective("cost", loc="final")
    elif case.objective["terminal"] == "tf":
        phase.add_objective("time", loc="final")
    elif case.objective["terminal"] == "-h_f":
        phase.add_objective("h", loc="final", scaler=-1)
    else:
        raise ValueError(f"no dymos objective for {case.objective}")
    problem.setup(force_alloc_complex=True)

    def again() -> Answer:
        phase.set_time_val(initial=0.0, duration=case.guess_time)
        knots = np.linspace(0, case.guess_time, 61)
        for name in case.states:
            values = [case.guess(name, tau) for tau in np.linspace(0, 1, 61)]
            phase.set_state_val(name, values, knots)
        if "running" in case.objective:
            phase.set_state_val("cost", [0.0, 1.0])
        for name in case.controls:
            phase.set_control_val(name, [case.guess(name, tau) for tau in np.linspace(0, 1, 61)], knots)
        result = problem.run_driver()
        times = problem.get_val("traj.phase.timeseries.time").ravel()
        rising = np.concatenate([[True], np.diff(times) > 0])
        clocks = {
            name: through_the_ends(
                times[rising],
                problem.get_val(f"traj.phase.timeseries.{name}").ravel()[rising],
                0.0,
                times[-1],
            )
            for name in case.controls
        }
        sign = -1.0 if case.objective.get("terminal") == "-h_f" else 1.0
        final = {"tf": "time", "-h_f": "h"}.get(case.objective.get("terminal", ""), "cost")
        return Answer(
            objective=sign * float(problem.get_val(f"traj.phase.timeseries.{final}").ravel()[-1]),
            times=next(iter(clocks.values()))[0],
            controls={name: values for name, (_, values) in clocks.items()},
            state_times=times[rising].tolist(),
            states={
                name: problem.get_val(f"traj.phase.timeseries.{name}").ravel()[rising].tolist()
                for name in case.states
            },
            success=bool(result.success),
            message=result.exit_status,
            mesh=f"LGR {segments} x {DEGREE}, SLSQP",
        )

    return again


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    # OpenMDAO writes a folder of reports wherever it runs.
    os.chdir(tempfile.mkdtemp())
    run("dymos", version("dymos"), build)
