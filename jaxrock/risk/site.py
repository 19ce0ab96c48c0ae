"""A site: ground motions, the hazard, and the levels at which outcomes are simulated."""

import math
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..ground_motion import Suite, require_positive_measures, warn_of_large_intensities
from ..host import Printed
from ..validation import (
    NON_NEGATIVE,
    POSITIVE,
    AnyArray,
    Numbers,
    Reals,
    as_name,
    as_real,
    check,
    check_increasing,
    check_kind,
    is_traced,
)
from .hazard import HAZARD_MEASURES, Hazard, find_last_point

Exceedance = Hazard | Callable[..., Reals]
# Levels of which the hazard is computed in one call: of one size, so that one program does for
# any number of boundaries.
_TOGETHER = 2**12


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
    hazard : Hazard or callable
        Rate of exceedance H [1/yr] of a level, which does not rise with the level.
    measure : {"pgv", "pga"}
        The intensity measure of the hazard [m/s], [m/s2].
    levels : array_like, shape (n,), optional
        At least two increasing levels, within the hazard curve. By default they cover all of
        it, up to the first rate of 0. They are needed if the hazard is a function.
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
        If an argument is out of range, the hazard is one of another measure, its rates rise
        with the level or are 0 at the first one, or a record has no intensity.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> print(jr.Site(suite, jr.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4])))
    suite of 1 record of 6 samples, 0.1 s apart
    hazard from 0.01 1/yr at 0.4 to 0.0001 1/yr at 4
    232 levels of pgv from 0.4 to 4 m/s
    """

    suite: Suite
    hazard: Exceedance
    measure: str = eqx.field(static=True)
    levels: Reals
    rates: Reals
    intensities: Reals

    def __init__(
        self,
        suite: Suite,
        hazard: Exceedance,
        measure: str = "pgv",
        levels: Numbers | None = None,
        *,
        spacing: float = 0.01,
    ):
        check_kind("suite", suite, Suite)
        check_kind("hazard", hazard, Hazard, Callable)
        self.measure = as_name("measure", measure, HAZARD_MEASURES)
        if isinstance(hazard, Hazard) and hazard.measure not in (None, self.measure):
            raise ValueError(
                f"measure is {self.measure!r}, but the hazard curve is for {hazard.measure}"
            )
        require_single_scales(suite)
        self.suite = suite
        self.hazard = hazard
        self.levels = _choose_site_levels(hazard, levels, spacing)
        warn_of_large_intensities("the hazard", self.levels, self.measure)
        self.rates = hazard(self.levels)
        _check_rates(self.rates, self.levels)
        self.intensities = require_positive_measures(suite, self.measure)

    def __str__(self) -> str:
        unit = "m/s" if self.measure == "pgv" else "m/s2"
        hazard = (
            str(self.hazard) if isinstance(self.hazard, Hazard) else "hazard by a function"
        )
        low, high = (float(level) for level in self.levels[jnp.array([0, -1])])
        levels = f"{len(self.levels)} levels of {self.measure} from {low:.4g} to {high:.4g}"
        return f"{self.suite}\n{hazard}\n{levels} {unit}"

    def replace_suite(self, suite: Suite) -> "Site":
        """Return the site under other ground motions, with its hazard, measure and levels.

        Parameters
        ----------
        suite : Suite
            A suite as in `Site`; for example that of this site on a floor, or in both
            directions.

        Returns
        -------
        Site

        Raises
        ------
        ValueError
            If the suite is not allowed, or a record has no intensity.

        Examples
        --------
        >>> import jaxrock as jr
        >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
        >>> site = jr.Site(suite, jr.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4]))
        >>> print(site.replace_suite(suite.both_directions()).suite)
        suite of 1 record in both directions of 6 samples, 0.1 s apart
        """
        check_kind("suite", suite, Suite)
        require_single_scales(suite)
        intensities = require_positive_measures(suite, self.measure)
        return eqx.tree_at(
            lambda site: (site.suite, site.intensities), self, (suite, intensities)
        )

    def exceed(self, levels: np.ndarray) -> np.ndarray:
        """Compute the rates at which concrete levels are exceeded, on the host.

        Parameters
        ----------
        levels : ndarray, shape (...)
            Inside of the hazard curve [m/s or m/s2].

        Returns
        -------
        ndarray, shape (...)
            [1/yr]
        """
        flat = levels.reshape(-1)
        size = -(-max(flat.size, 1) // _TOGETHER) * _TOGETHER
        first = np.asarray(self.levels)[0]
        padded = np.full(size, first, first.dtype)
        padded[: flat.size] = flat
        parts = [self.hazard(part) for part in padded.reshape(-1, _TOGETHER)]
        rates = np.concatenate([np.asarray(part) for part in parts])[: flat.size]
        return rates.reshape(levels.shape)


def require_single_scales(suite: Suite) -> None:
    """Raise `ValueError` if records of a suite have arrays of scales."""
    for name, record in zip(suite.names, suite, strict=True):
        shape = np.shape(record.scale)
        if shape:
            raise ValueError(
                f"scales of records must be single numbers, got an array of shape {shape} for"
                f" {name!r}"
            )


def check_levels(name: str, levels: Numbers, least: int = 1) -> Reals:
    """Return levels as an array; a `ValueError` if they do not increase, or are too few."""
    places = as_real(name, levels)
    check(name, places, POSITIVE)
    if places.ndim != 1 or len(places) < least:
        values = "two values" if least > 1 else "one value"
        raise ValueError(
            f"{name} must be one-dimensional, of at least {values}, got an array of shape"
            f" {places.shape}"
        )
    if not is_traced(places):
        check_increasing(name, places)
    return places


def _choose_site_levels(hazard: Exceedance, levels: Numbers | None, spacing: float) -> Reals:
    """Choose the levels at which to simulate; a `ValueError` if these are not allowed."""
    ends = None
    if isinstance(hazard, Hazard) and not is_traced(hazard.levels):
        ends = np.asarray(hazard.levels)[[0, -1]].tolist()
    if levels is None:
        if not isinstance(spacing, float | int) or not 1e-3 <= spacing <= 0.2:
            raise ValueError(f"spacing must be from 0.001 to 0.2, got {spacing!r:.60}")
        if ends is None:
            raise ValueError("levels must be given, since the hazard is a function or traced")
        low, high = ends
        if not is_traced(hazard) and isinstance(hazard, Hazard):
            high = float(hazard.levels[find_last_point(hazard)])
        # The ends as they are: rounded ones could lie outside of the hazard curve.
        number = max(3, math.ceil(math.log(high / low) / spacing) + 1)
        inner = np.geomspace(low, high, number)
        return as_real("levels", np.concatenate([[low], inner[1:-1], [high]]))
    places = check_levels("levels", levels, 2)
    if is_traced(places):
        return places
    # Levels that are those of the hazard up to rounding are moved onto it.
    slack = 8 * float(jnp.finfo(places.dtype).eps)
    low = float(places[0])
    high = float(places[-1])
    if ends and (low < ends[0] * (1 - slack) or high > ends[1] * (1 + slack)):
        raise ValueError(
            f"levels must be within those of the hazard, {ends[0]:.6g} to {ends[1]:.6g},"
            f" got {low:.6g} to {high:.6g}"
        )
    return jnp.clip(places, *ends) if ends else places


def _check_rates(rates: AnyArray, levels: Reals) -> None:
    """Raise `ValueError` if a concrete hazard rises with the level, or begins with 0."""
    if is_traced(rates):
        return
    check("the rates of the hazard", rates, NON_NEGATIVE)
    values = np.asarray(as_real("rates", rates))
    if not values[0]:
        raise ValueError(
            "the rate of the hazard must be greater than 0 at the first level, got 0"
        )
    # Where a curve is level, its rates differ by what rounding makes of their logarithms.
    slack = 64 * float(np.finfo(values.dtype).eps)
    for k in np.flatnonzero(np.diff(values) > slack * values[:-1]):
        raise ValueError(
            f"the hazard must not rise with the level, got {values[k]:.6g} at"
            f" {float(levels[k]):.6g} and {values[k + 1]:.6g} at {float(levels[k + 1]):.6g}"
        )
