"""Grids that are computed in parts: in memory, in files, lazily by Dask, in Zarr stores.

Dask and Zarr come with ``jaxrock[cluster]``. With ``chunks``, functions that return a dataset
over a grid return it lazily: `resonance_spectrum`, `rocking_spectrum`,
`overturning_spectrum`, `overturning_map` and `harmonic_spectrum`.
"""

from importlib.util import find_spec
from typing import TYPE_CHECKING

from ..host import import_optional
from .axes import DataType as DataType
from .axes import GridVariable as GridVariable
from .axes import Values as Values
from .axes import as_axis as as_axis
from .axes import describe_axis as describe_axis
from .axes import expand_scalars as expand_scalars
from .grid import Grid as Grid
from .grid import apply_in_tiles as apply_in_tiles
from .grid import apply_padded as apply_padded
from .grid import list_points as list_points
from .tables import compute_overturned_fraction as compute_overturned_fraction
from .tables import write_table

if TYPE_CHECKING:
    from .lazy import Chunks as Chunks
    from .workers import OwnProcessors, local_cluster
    from .zarr_store import Stored, write_zarr

__all__ = ["write_table"]
# Without Dask they are not listed either: `help` and a star import get all that is listed.
if all(find_spec(name) for name in ("dask", "distributed", "zarr")):
    __all__ += ["OwnProcessors", "Stored", "local_cluster", "write_zarr"]

# They need Dask, which not every user has, and which takes longer to import than the rest.
_BY_DASK = {
    "Chunks": "lazy",
    "OwnProcessors": "workers",
    "local_cluster": "workers",
    "Stored": "zarr_store",
    "write_zarr": "zarr_store",
}


def __getattr__(name: str) -> object:
    """Import what needs Dask when it is used first."""
    if name not in _BY_DASK:
        raise AttributeError(f"module {__name__} has no attribute {name!r}")
    return getattr(import_optional(f"{__name__}.{_BY_DASK[name]}", "cluster"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
