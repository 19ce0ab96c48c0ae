"""A grid computed in parts: in memory, in a file, lazily by Dask, by workers, into a Zarr store.

What Dask is needed for comes with ``jaxrock[cluster]``. Functions that return a dataset over a
grid take ``chunks`` and are lazy then: `resonance_spectrum`, `rocking_spectrum`,
`overturning_spectrum`, `overturning_map`, `harmonic_spectrum` and `fragility`. Names beside
those in ``__all__`` are for the other packages.
"""

from typing import TYPE_CHECKING, Any

from ..host import import_optional
from .axes import Values as Values
from .axes import axis as axis
from .grid import Grid as Grid
from .grid import along as along
from .grid import flat as flat
from .grid import in_tiles as in_tiles
from .grid import of_few_shapes as of_few_shapes
from .tables import overturned_share as overturned_share
from .tables import write_table

if TYPE_CHECKING:
    from .lazy import Chunks as Chunks
    from .lazy import lazily_from as lazily_from
    from .workers import OwnProcessors, local_cluster
    from .zarr_store import Stored, write_zarr

__all__ = ["OwnProcessors", "Stored", "local_cluster", "write_table", "write_zarr"]

# Imported when used first: they need Dask, which not every user has.
_BY_DASK = {
    "Chunks": "lazy",
    "lazily_from": "lazy",
    "OwnProcessors": "workers",
    "local_cluster": "workers",
    "Stored": "zarr_store",
    "write_zarr": "zarr_store",
}


def __getattr__(name: str) -> Any:
    if name not in _BY_DASK:
        raise AttributeError(f"module {__name__} has no attribute {name!r}")
    return getattr(import_optional(f"{__name__}.{_BY_DASK[name]}", "cluster"), name)
