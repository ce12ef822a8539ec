"""The models that come with the product: one file each, collected in `LIBRARY`."""

from collections.abc import Mapping

from solvers.models import flexible_spacecraft, rigid_body
from solvers.models.library_model import LibraryModel, Parameter, Quantity

LIBRARY: Mapping[str, LibraryModel] = {
    model.name: model for model in (rigid_body.MODEL, flexible_spacecraft.MODEL)
}

__all__ = ["LIBRARY", "LibraryModel", "Parameter", "Quantity"]
