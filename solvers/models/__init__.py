"""The models that come with the product: one file each, collected in `LIBRARY`."""

from collections.abc import Mapping

from solvers.models import flexible_spacecraft, rigid_body, solar_array
from solvers.models.library_model import LibraryModel, Parameter, Quantity

LIBRARY: Mapping[str, LibraryModel] = {
    model.name: model for model in (rigid_body.MODEL, flexible_spacecraft.MODEL, solar_array.MODEL)
}

__all__ = ["LIBRARY", "LibraryModel", "Parameter", "Quantity"]
