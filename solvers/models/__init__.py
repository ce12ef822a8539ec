"""The models that come with the product: one file each, collected in `LIBRARY`."""

from collections.abc import Mapping

from solvers.models import attitude, edt, edt_plant, flexible_spacecraft, pse, rigid_body, solar_array
from solvers.models.computed import Computed, Formula
from solvers.models.library_model import LibraryModel, Parameter, Quantity, View

LIBRARY: Mapping[str, LibraryModel] = {
    model.name: model
    for model in (
        rigid_body.MODEL,
        flexible_spacecraft.MODEL,
        attitude.MODEL,
        solar_array.MODEL,
        edt.MODEL,
        edt_plant.MODEL,
        pse.HILL,
        pse.EXACT,
        pse.SMALL_ANGLE,
    )
}

__all__ = ["LIBRARY", "Computed", "Formula", "LibraryModel", "Parameter", "Quantity", "View"]
