"""A site: ground motions, the hazard, and the levels at which outcomes are simulated."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..ground_motion import Suite, require_positive_measures, warn_of_large_intensities
from ..host import Printed
from ..validation import Numbers, Reals, as_name, as_real, check_kind, is_traced
from .hazard import HAZARD_MEASURES, Hazard, check_levels


class Site(Printed, eqx.Module):
    """Ground motions and the hazard of a site, checked once.

    Each record is scaled to levels of the intensity measure, and the hazard says how often
    they are exceeded. Outcomes are simulated at these levels, and a boundary of overturning
    is located between neighbouring levels whose outcomes differ. Two boundaries between the
    same two levels are not detected.

    Parameters
    ----------
    suite : Suite
        Each record with a single scale. For a suite on a floor, the ground is scaled to the
        levels, and the floor with it.
    hazard : Hazard
        Rate of exceedance H [1/yr] of a level.
    measure : {"pgv", "pga"}, optional
        The intensity measure [m/s], [m/s2]; by default the one of the hazard, PGV where it
        states none.
    levels : array_like, shape (n,), optional
        At least two increasing levels, within the hazard curve. By default they cover all of
        it.
    spacing : float
        Relative distance of the default levels, from 0.001 to 0.2.

    Attributes
    ----------
    rates : Array, shape (n,)
        The hazard at the levels [1/yr].
    intensities : Array, shape (records,)
        The measure of each record of the suite, or of the ground below its floor.

    Raises
    ------
    ValueError
        If an argument is out of range, the hazard is one of another measure, or a record has no
        intensity.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> print(jr.risk.Site(suite, jr.risk.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4])))
    suite of 1 record of 6 samples, 0.1 s apart
    hazard from 0.01 1/yr at 0.4 to 0.0001 1/yr at 4
    232 levels of pgv from 0.4 to 4 m/s
    """

    suite: Suite
    hazard: Hazard
    measure: str = eqx.field(static=True)
    levels: Reals
    rates: Reals
    intensities: Reals

    def __init__(
        self,
        suite: Suite,
        hazard: Hazard,
        measure: str | None = None,
        levels: Numbers | None = None,
        *,
        spacing: float = 0.01,
    ):
        check_kind("suite", suite, Suite)
        check_kind("hazard", hazard, Hazard)
        measure = measure or hazard.measure or "pgv"
        self.measure = as_name("measure", measure, HAZARD_MEASURES)
        if hazard.measure not in (None, self.measure):
            raise ValueError(
                f"measure is {self.measure!r}, but the hazard curve is for {hazard.measure}"
            )
        require_single_scales(suite)
        self.suite = suite
        self.hazard = hazard
        self.levels = _choose_site_levels(hazard, levels, spacing)
        warn_of_large_intensities("the hazard", self.levels, self.measure)
        self.rates = hazard(self.levels)
        self.intensities = require_positive_measures(suite, self.measure)

    def __str__(self) -> str:
        unit = "m/s" if self.measure == "pgv" else "m/s2"
        low, high = (float(level) for level in self.levels[jnp.array([0, -1])])
        levels = f"{len(self.levels)} levels of {self.measure} from {low:.4g} to {high:.4g}"
        return f"{self.suite}\n{self.hazard}\n{levels} {unit}"


def require_single_scales(suite: Suite) -> None:
    """Raise `ValueError` if records of a suite have arrays of scales."""
    for name, record in zip(suite.names, suite, strict=True):
        if shape := np.shape(record.scale):
            raise ValueError(
                f"scales of records must be single numbers, got shape {shape} for {name!r}"
            )


def _choose_site_levels(hazard: Hazard, levels: Numbers | None, spacing: float | int) -> Reals:
    """Choose the levels at which to simulate; a `ValueError` if these are not allowed."""
    if levels is None and is_traced(hazard.levels):
        raise ValueError("levels must be given, since those of the hazard are traced")
    if levels is None:
        if not isinstance(spacing, float | int) or not 1e-3 <= spacing <= 0.2:
            raise ValueError(f"spacing must be from 0.001 to 0.2, got {spacing!r:.60}")
        low, high = np.asarray(hazard.levels)[[0, -1]].tolist()
        number = max(3, math.ceil(math.log(high / low) / spacing) + 1)
        return as_real("levels", np.geomspace(low, high, number))
    given = check_levels("levels", levels, 2)
    if is_traced((given, hazard.levels)):
        return given
    low, high = np.asarray(hazard.levels)[[0, -1]].tolist()
    # Levels that are those of the hazard up to rounding are moved onto it.
    within = jnp.clip(given, low, high)
    if not np.allclose(within, given, rtol=8 * jnp.finfo(given.dtype).eps, atol=0):
        raise ValueError(
            f"levels must be within those of the hazard, {low:.6g} to {high:.6g}, got"
            f" {given[0]:.6g} to {given[-1]:.6g}"
        )
    return within
