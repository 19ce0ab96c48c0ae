"""Beyond one process: lazy grids on Dask, workers, and Zarr stores that can be continued.

Needs ``jaxrock[cluster]``. Functions that return a dataset over a grid take ``chunks`` and are
lazy then: `resonance_spectrum`, `rocking_spectrum`, `overturning_spectrum`, `overturning_map`,
`harmonic_spectrum` and `fragility`. Names beside those in ``__all__`` are for the other
packages.
"""

from .lazy import Chunks as Chunks
from .lazy import chunks_along as chunks_along
from .lazy import lazily_from as lazily_from
from .lazy import lazy_arrays as lazy_arrays
from .workers import OwnProcessors, local_cluster
from .zarr_store import Stored, write_zarr

__all__ = ["OwnProcessors", "Stored", "local_cluster", "write_zarr"]
