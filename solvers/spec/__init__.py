"""The job document: read strictly, checked as a whole, every mistake reported with its JSON pointer.

``check_text(text)`` gives a `JobSpec`; its fields hold values as submitted (numbers or
expressions), and the functions below turn them into numbers and intervals.
"""

from solvers.spec.check import check_document, check_text, job_schema
from solvers.spec.command import CommandSpec
from solvers.spec.document import parse_document
from solvers.spec.genetic import GeneticMethod
from solvers.spec.job import JobSpec, Options, Output, Verification
from solvers.spec.method_model import Adaptivity, SplineAdaptivity
from solvers.spec.methods import (
    METHODS,
    AutoMethod,
    GaussPseudospectralMethod,
    HermiteSimpsonMethod,
    Method,
    PiecewiseMethod,
    SplineWaveletMethod,
)
from solvers.spec.models import (
    FirstOrderModel,
    LibraryReference,
    MechanicalModel,
    SubmittedModel,
    definitions_of,
    written_out,
)
from solvers.spec.parts import BoundaryConstraint, DesignSpec, Guess, Objective, PathConstraint
from solvers.spec.phase_merge import PhaseView, fields_of, phase_fields, phase_views
from solvers.spec.phases import LinkSpec, PhaseSpec
from solvers.spec.piecewise import Plant, Segments, Stop, Tracking
from solvers.spec.problem import ProblemSpec, final_intervals, initial_intervals, path_intervals
from solvers.spec.resolution import Resolution, answer_digest, canonical_json
from solvers.spec.scenarios import ScenarioSpec
from solvers.spec.scope import VIBRATION_ENERGY
from solvers.spec.values import BoundValue, Interval, Value, bound_interval, evaluate_constant, inside

__all__ = [
    "METHODS",
    "VIBRATION_ENERGY",
    "Adaptivity",
    "AutoMethod",
    "BoundValue",
    "BoundaryConstraint",
    "CommandSpec",
    "DesignSpec",
    "FirstOrderModel",
    "GaussPseudospectralMethod",
    "GeneticMethod",
    "Guess",
    "HermiteSimpsonMethod",
    "Interval",
    "JobSpec",
    "LibraryReference",
    "LinkSpec",
    "MechanicalModel",
    "Method",
    "Objective",
    "Options",
    "Output",
    "PathConstraint",
    "PhaseSpec",
    "PhaseView",
    "PiecewiseMethod",
    "Plant",
    "ProblemSpec",
    "Resolution",
    "ScenarioSpec",
    "Segments",
    "SplineAdaptivity",
    "SplineWaveletMethod",
    "Stop",
    "SubmittedModel",
    "Tracking",
    "Value",
    "Verification",
    "answer_digest",
    "bound_interval",
    "canonical_json",
    "check_document",
    "check_text",
    "definitions_of",
    "evaluate_constant",
    "fields_of",
    "final_intervals",
    "initial_intervals",
    "inside",
    "job_schema",
    "parse_document",
    "path_intervals",
    "phase_fields",
    "phase_views",
    "written_out",
]
