"""The sampled trajectory of a result in the formats of other programs.

Names of states and controls are identifiers (the document admits nothing else), so no cell of a table can be
taken for a formula.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def columns(trajectory: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
    """The columns of a sampled trajectory by name: ``t``, states, controls, outputs, ``<state>_rate``."""
    named = {"t": trajectory["t"]}
    for group, suffix in (("states", ""), ("controls", ""), ("outputs", ""), ("rates", "_rate")):
        named |= {name + suffix: values for name, values in trajectory.get(group, {}).items()}
    return {name: np.array(values, dtype=np.float64) for name, values in named.items()}


def trajectory_csv(trajectory: Mapping[str, Any]) -> str:
    """A header of names, then a row for each sample, with every digit that a double has."""
    named = columns(trajectory)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(named)
    writer.writerows(np.column_stack(list(named.values())).tolist())
    return text.getvalue()


def to_csv(result: Mapping[str, Any]) -> str:
    """The sampled trajectory of a result as CSV; of flights a row for each of them."""
    return flights_csv(result) if result.get("kind") == "flights" else trajectory_csv(result["trajectory"])


def flights_csv(result: Mapping[str, Any]) -> str:
    """The columns of flights: a header of names, then a row for each run; empty where it was lost."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["run", *result["columns"]])
    rows = zip(*result["columns"].values(), strict=True)
    writer.writerows([run, *row] for run, row in enumerate(rows))
    return text.getvalue()


def to_npz(result: Mapping[str, Any]) -> bytes:
    """The sampled trajectory as NumPy arrays by name; loads without pickle."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **columns(result["trajectory"]))
    return buffer.getvalue()


def to_mat(result: Mapping[str, Any]) -> bytes:
    """A MATLAB 5 file: ``t``, structures ``states``, ``controls``, ``outputs``, and two scalars."""
    from scipy.io import savemat

    trajectory = result["trajectory"]
    content: dict[str, Any] = {"t": np.array(trajectory["t"], dtype=np.float64)}
    for group in ("states", "controls", "outputs"):
        content[group] = {
            name: np.array(values, dtype=np.float64) for name, values in trajectory.get(group, {}).items()
        }
    for scalar in ("objective", "final_time"):
        content[scalar] = np.nan if result[scalar] is None else result[scalar]
    buffer = io.BytesIO()
    # scipy takes open files too, which its stubs do not know.
    savemat(buffer, content, long_field_names=True, oned_as="column")  # type: ignore[arg-type]
    return buffer.getvalue()


def command_csv(command: Mapping[str, Any]) -> str:
    """A command table: a header of ``t`` and controls, then a row for each period."""
    return trajectory_csv({"t": command["t"], "controls": command["controls"]})


def command_mat(command: Mapping[str, Any]) -> bytes:
    """A MATLAB 5 file with the structure ``command`` that Simulink's From Workspace block reads.

    ``time`` (K x 1), ``signals.values`` (K x m), ``signals.dimensions`` m, ``signals.label`` the names. Set
    the block to hold values between the times (interpolate data off).
    """
    from scipy.io import savemat

    names = list(command["controls"])
    values = np.array([command["controls"][name] for name in names], dtype=np.float64).T
    signals = {"values": values, "dimensions": float(len(names)), "label": ", ".join(names)}
    time = np.array(command["t"], dtype=np.float64)[:, None]
    content = {"command": {"time": time, "signals": signals}, "period": float(command["period"])}
    buffer = io.BytesIO()
    # scipy takes open files too, which its stubs do not know.
    savemat(buffer, content, long_field_names=True)  # type: ignore[arg-type]
    return buffer.getvalue()
