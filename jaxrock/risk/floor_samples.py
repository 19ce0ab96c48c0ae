"""The ground motions of samples: with uncertain floors, each sample has a floor of its own."""

import numpy as np

from ..driven import RecordVariants
from ..ground_motion import Suite, vary_floor
from ..sensitivity import FloorFactors


def vary_motions(suite: Suite, floors: FloorFactors | None) -> Suite | RecordVariants:
    """Put the ground of a suite on the floors of samples; the suite itself if there are none.

    Parameters
    ----------
    suite : Suite
        On a floor, if there are factors on its period and damping.
    floors : FloorFactors of shape (...), or None

    Returns
    -------
    Suite or RecordVariants
    """
    if floors is None:
        return suite
    # Objects share the floors of samples: each is filtered once.
    pairs = np.stack([np.ravel(factors) for factors in floors], axis=-1)
    different, which = np.unique(pairs, axis=0, return_inverse=True)
    records = vary_floor(suite, *different.T)
    return RecordVariants(records, which.reshape(np.shape(floors.period)).astype(float))
