"""A population of blocks: how the blocks of a series of tests are distributed."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ...host import Printed, format_fields
from ...validation import Reals

# Parameters of a block: a population is normal in ln(alpha_c), ln(p) and logit(C).
NAMES = ("critical_angle", "frequency_parameter", "restitution")
UNITS = {"critical_angle": "rad", "frequency_parameter": "1/s"}
FRACTIONS = ("restitution", "lapse")


class Population(Printed, eqx.Module):
    """The population from which each test of a series has a block of its own.

    The logarithms of alpha_c and p and the logit of C are jointly normal.

    Attributes
    ----------
    critical_angle, frequency_parameter, restitution : Array
        Medians of alpha_c [rad], p [1/s] and C [-].
    critical_angle_deviation, frequency_parameter_deviation, restitution_deviation : Array
        Standard deviations of ln(alpha_c), ln(p) and logit(C) from test to test [-].
    correlation_critical_angle_frequency_parameter : Array
        Correlation of ln(alpha_c) and ln(p) [-].
    correlation_critical_angle_restitution : Array
        Correlation of ln(alpha_c) and logit(C) [-].
    correlation_frequency_parameter_restitution : Array
        Correlation of ln(p) and logit(C) [-].
    lapse : Array
        Probability that the outcome of a test does not depend on its block: overturning and
        standing are then equally likely [-].
    group_deviation : Array
        Standard deviation of a change of ln(alpha_c) that all tests of a group share [-].
    """

    critical_angle: Reals
    frequency_parameter: Reals
    restitution: Reals
    critical_angle_deviation: Reals
    frequency_parameter_deviation: Reals
    restitution_deviation: Reals
    correlation_critical_angle_frequency_parameter: Reals
    correlation_critical_angle_restitution: Reals
    correlation_frequency_parameter_restitution: Reals
    lapse: Reals
    group_deviation: Reals

    def __str__(self) -> str:
        return format_fields(self, **dict.fromkeys(vars(self), "") | UNITS)

    @property
    def mean(self) -> Reals:
        """Mean of ln(alpha_c), ln(p) and logit(C), shape (3,)."""
        odds = self.restitution / (1 - self.restitution)
        return jnp.log(jnp.stack([self.critical_angle, self.frequency_parameter, odds]))

    @property
    def factor(self) -> Reals:
        """Lower Cholesky factor of the covariance of ln(alpha_c), ln(p), logit(C), (3, 3)."""
        r21 = self.correlation_critical_angle_frequency_parameter
        r31 = self.correlation_critical_angle_restitution
        r32 = self.correlation_frequency_parameter_restitution
        # The factor is written out: a factorization would give NaN where rounding makes the
        # matrix indefinite, as at a correlation of 1.
        l22 = jnp.sqrt(jnp.maximum(1 - r21**2, 0))
        l32 = (r32 - r21 * r31) / l22
        l33 = jnp.sqrt(jnp.maximum(1 - r31**2 - l32**2, 0))
        zero = jnp.zeros_like(r21)
        rows = [zero + 1, zero, zero, r21, l22, zero, r31, l32, l33]
        deviations = [getattr(self, f"{name}_deviation") for name in NAMES]
        return jnp.stack(deviations)[:, None] * jnp.stack(rows).reshape(3, 3)


def make_population(unbounded: Population) -> Population:
    """Make the population of unbounded parameters; the last correlation is a partial one.

    The partial correlation of ln(p) and logit(C) at a given alpha_c may have any value,
    independent of the other two correlations.
    """
    values = {}
    for name, value in vars(unbounded).items():
        if name in FRACTIONS:
            values[name] = jax.nn.sigmoid(value)
        elif name.startswith("correlation"):
            values[name] = jnp.tanh(value)
        else:
            values[name] = jnp.exp(value)
    r21 = values["correlation_critical_angle_frequency_parameter"]
    r31 = values["correlation_critical_angle_restitution"]
    partial = values["correlation_frequency_parameter_restitution"]
    r32 = r21 * r31 + partial * jnp.sqrt((1 - r21**2) * (1 - r31**2))
    values["correlation_frequency_parameter_restitution"] = r32
    return Population(**values)
