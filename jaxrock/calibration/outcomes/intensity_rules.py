"""Overturning by the intensity of a motion alone: what a population of blocks has to beat."""

from typing import NamedTuple

import numpy as np

from ...ground_motion import Suite, measure_drift
from ...validation import POSITIVE, check

# Standard deviation of the Gaussian priors of intercept and coefficient, per standard deviation
# of the logarithm of the intensity. Weakly informative, as in Gelman, Jakulin, Pittau and Su
# (2008, doi:10.1214/08-AOAS191). In 300 simulated sets of 50 tests it moves the logit by at most
# 0.05 of its standard error in the median, 0.11 in 90 % of them; it keeps the curve finite where
# outcomes are separated.
_PRIOR_DEVIATION = 5.0
# Logarithms that differ by less are those of one intensity, but for rounding.
_LEAST_DEVIATION = 1e-9


class IntensityRule(NamedTuple):
    """Logistic probability of overturning by the logarithm of an intensity.

    Attributes
    ----------
    intercept : float
        Logit of the probability at an intensity of 1 [-].
    slope : float
        Derivative of the logit with respect to ln(intensity) [-].
    """

    intercept: float
    slope: float

    def probability(self, intensity: np.ndarray) -> np.ndarray:
        """Compute the probability of overturning.

        Parameters
        ----------
        intensity : ndarray, shape (...)
            In the unit of those that were fitted, at least 0.

        Returns
        -------
        ndarray, shape (...)
            Between 0 and 1 [-].
        """
        from scipy.special import expit

        with np.errstate(divide="ignore"):
            return expit(self.intercept + self.slope * np.log(intensity))


def fit_intensity_rule(
    intensity: np.ndarray, overturned: np.ndarray, weights: np.ndarray | None = None
) -> IntensityRule:
    """Fit a logistic regression in the logarithm of an intensity to outcomes.

    Of greatest posterior density, with Gaussian priors of standard deviation 5 for the
    intercept and the coefficient of the standardized logarithm. So it is finite also where an
    intensity separates the outcomes, where all are the same, and for a single test.

    Parameters
    ----------
    intensity : ndarray, shape (tests,)
        Greater than 0, in any unit; at least one.
    overturned : ndarray of bool, shape (tests,)
    weights : ndarray, shape (tests,), optional
        Weights of the tests [-], at least 0, of any sum above 0; by default all are 1.

    Returns
    -------
    IntensityRule

    Raises
    ------
    ValueError
        If an intensity is not greater than 0.
    """
    from scipy.optimize import minimize
    from scipy.special import expit

    check("intensity", intensity, POSITIVE)
    weight = np.ones(intensity.size) if weights is None else weights
    logarithm = np.log(intensity)
    mean = np.average(logarithm, weights=weight)
    deviation = np.average((logarithm - mean) ** 2, weights=weight) ** 0.5
    if not deviation > _LEAST_DEVIATION:
        deviation = 1.0
    design = np.stack([np.ones(intensity.size), (logarithm - mean) / deviation], axis=-1)
    # Logits of what happened are those of overturning with this sign.
    sign = np.where(overturned, 1.0, -1.0)

    def compute_loss(coefficients: np.ndarray) -> tuple[float, np.ndarray]:
        """Compute -ln(posterior density), but for a constant, and its gradient."""
        logit = sign * (design @ coefficients)
        loss = weight @ np.logaddexp(0, -logit)
        loss += 0.5 * np.square(coefficients / _PRIOR_DEVIATION).sum()
        gradient = -(weight * sign * expit(-logit)) @ design
        return float(loss), gradient + coefficients / _PRIOR_DEVIATION**2

    def compute_curvature(coefficients: np.ndarray) -> np.ndarray:
        """Compute the second derivatives of the loss, which is convex."""
        probability = expit(design @ coefficients)
        information = weight * probability * (1 - probability)
        return (information[:, None] * design).T @ design + np.eye(2) / _PRIOR_DEVIATION**2

    # Newton's method within a trust region: plain steps may diverge where outcomes are nearly
    # separated.
    result = minimize(
        compute_loss,
        np.zeros(2),
        jac=True,
        hess=compute_curvature,
        method="trust-exact",
        options={"gtol": 1e-9 * max(1.0, float(weight.sum()))},
    )
    standardized_intercept, standardized_slope = (float(value) for value in result.x)
    slope = standardized_slope / float(deviation)
    return IntensityRule(standardized_intercept - slope * float(mean), slope)


def measure_tests(suite: Suite) -> dict[str, np.ndarray]:
    """Measure the intensities of motions of tests, as they are scaled.

    The peak ground velocity is the one without the drift, a straight line from rest to the
    velocity at the end: a shaking table starts and ends at rest, and an accelerometer with an
    offset makes it seem to move on. Of a suite on a floor, the intensities are those of the
    ground.

    Parameters
    ----------
    suite : Suite
        Concrete, of one scale for each record.

    Returns
    -------
    dict
        ``"pgv"`` [m/s] and ``"pga"`` [m/s2], each of shape (tests,). Both are exact for lines
        between samples.
    """
    records = suite.records if suite.ground is None else suite.ground.records
    scales = np.array([abs(float(record.scale)) for record in records])
    # In NumPy: JAX would compile a program for every number of samples.
    accelerations = [np.abs(np.asarray(record.acceleration)).max() for record in records]
    velocities = [measure_drift(record).steady for record in records]
    return {
        "pgv": scales * np.array(velocities),
        "pga": scales * np.array(accelerations, float),
    }
