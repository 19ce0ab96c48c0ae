"""Grids that are computed in parts: in memory, in files, lazily by Dask, in Zarr stores.

Dask and Zarr come with ``jaxrock[cluster]``. With ``chunks``, functions that return a dataset
over a grid return it lazily: `resonance_spectrum`, `rocking_spectrum`, `overturning_map` and
`harmonic_spectrum`.
"""

from .axes import Chunks as Chunks
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
from .zarr_store import write_zarr

__all__ = ["write_table", "write_zarr"]


def __dir__() -> list[str]:
    return __all__
