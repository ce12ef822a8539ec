"""The arrows that the import linter cannot check, and those of a running process."""

from __future__ import annotations

import subprocess
import sys

import grimp
import pytest


def test_the_web_process_starts_without_the_optimizer() -> None:
    """What the linter proves of the source, seen in a process: nothing loads CasADi behind its back."""
    code = "import sys, app.main; app.main.create_app(); print('casadi' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, "False\n"), run.stderr


def test_the_command_line_starts_without_anything_heavy() -> None:
    heavy = ("casadi", "numpy", "celery", "fastapi", "httpx", "rich")
    code = f"import sys, app.cli; print([name for name in {heavy} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, "[]\n"), run.stderr


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph("solvers", include_external_packages=True)


def test_bases_import_numpy_and_scipy_only(graph: grimp.ImportGraph) -> None:
    package = {"solvers.bases", *graph.find_descendants("solvers.bases")}
    assert len(package) > 3
    imported = set().union(*(graph.find_modules_directly_imported_by(module) for module in package)) - package
    assert {name for name in imported if name not in sys.stdlib_module_names} == {"numpy", "scipy"}
