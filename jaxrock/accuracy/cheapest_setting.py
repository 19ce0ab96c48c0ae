"""As much model as a scene requires: the cheapest setting that keeps a tolerance."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..driven import TOLERANCES, respond_within
from ..ground_motion import Pulse
from ..host import Printed, format_fields
from ..resonance import Scene
from ..validation import (
    POSITIVE,
    Booleans,
    Integers,
    Number,
    Reals,
    as_real,
    check,
    check_concrete,
    check_kind,
    is_traced,
)
from .model_errors import model_error


@dataclass(frozen=True, repr=False)
class Setting(Printed):
    """Level of fidelity, precision, tolerance, solver and size of batch of a computation."""

    level: str  # linearized, nonlinear, pulsed, batch or adaptive
    bits: int
    rtol: float = 0.0  # of batch and adaptive
    solver: str = "-"  # of adaptive
    batch: int = 1

    def __str__(self) -> str:
        solver = f" with {self.solver}" if self.solver != "-" else ""
        rtol = f" at rtol {self.rtol:g}" if self.rtol else ""
        return f"{self.level}{solver}{rtol} in float{self.bits}"


# From the cheapest on, as `measure_tradeoff` finds them: `choose` takes the first that is
# enough.
CLOSED = tuple(
    Setting(level, bits) for level in ("linearized", "nonlinear") for bits in (32, 64)
)
# The error of `pulsed_phase` at its default tolerance, as a change of the intensity.
_PULSED_SLIP = 1e-8


class Choice(Printed, eqx.Module):
    """The cheapest setting whose error is within a tolerance; see `choose`.

    Attributes
    ----------
    index : Array of int
        Index into `settings`.
    error : Array
        Predicted bound on the relative error of this setting.
    within_tolerance : Array of bool
        Whether `error` is within the tolerance. If not, the setting is the most accurate one.
    settings : tuple of Setting
        All settings that were compared, the cheapest first: level of fidelity, bits, and rtol
        of the batch.
    """

    index: Integers
    error: Reals
    within_tolerance: Booleans
    settings: tuple[Setting, ...] = eqx.field(static=True)

    @property
    def setting(self) -> Setting:
        """The setting for a single scene."""
        return self.settings[int(self.index)]

    def __str__(self) -> str:
        if is_traced(self.index) or jnp.ndim(self.index):
            return format_fields(self, index="", error="", within_tolerance="")
        return f"{self.setting}: off by at most {float(self.error):.1e}"


def choose(
    scene: Scene | tuple,
    tolerance: float,
    shape: type[Pulse] | None = None,
    duration: Number = 0.0,
) -> Choice:
    """Choose the cheapest level of fidelity, precision and `rtol` within a tolerance.

    Parameters
    ----------
    scene : Scene or tuple
        A `Scene`, or the block, restitution and motion of `respond_batch`. Elementwise: every
        element gets a setting of its own.
    tolerance : float
        Allowed relative error. For a `Scene` it applies to the rotation ratio, the period and
        the critical intensity, under a motion to the peak rotation. A setting that
        predicts standing for a block that overturns is never within tolerance.
    shape : type, optional
        Shape of the pulses of a `Scene`, `Rectangular` or `HalfSine`. By default the pulses
        are instantaneous.
    duration : array_like, optional
        Duration of those pulses [s].

    Returns
    -------
    Choice

    Raises
    ------
    ValueError
        If an argument is not allowed.

    Notes
    -----
    The setting for a `Scene` follows from `model_error`, before anything is computed under
    pulses of finite duration. Under a motion the block is simulated by
    `respond_within`, which compares it with less accurate simulations. 64 bits are considered
    only if JAX is set to them; a simulation keeps its own precision.

    Examples
    --------
    >>> import jax
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(half_width=0.4, slenderness=5.0), 0.7, 0.15)
    >>> print(jr.accuracy.choose(wall, 0.01).setting)
    linearized in float32
    """
    check_concrete((scene, tolerance, shape, duration), "the choice depends on the answers")
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    tolerance = float(tolerance)
    if isinstance(scene, tuple):
        return _choose_rtol(scene, tolerance)
    check_kind("scene", scene, Scene, hint="; or a tuple (block, restitution, motion)")
    widest = int(jnp.finfo(jnp.result_type(float)).bits)
    # Costs are computed in the widest precision on offer, whatever the scene has.
    exact: Scene = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), scene)
    predicted = model_error(exact, shape, duration)
    settings = tuple(setting for setting in CLOSED if setting.bits <= widest)
    errors = [predicted.total(each.level, each.bits).largest for each in settings]
    if shape is not None:
        settings += (Setting("pulsed", widest),)
        # Rounding to float32 is a slip of the intensity, too. Its cost, in proportion to the
        # slips, is that of `pulsed_phase`: another closed form need not be computed.
        slip = _PULSED_SLIP / float(jnp.finfo(jnp.float32).eps)
        errors.append(slip * predicted.rounding["nonlinear"][32].largest)
    table = jnp.stack(errors)
    within = table <= tolerance
    # The first within the tolerance, element by element; the best where there is none.
    index = jnp.where(within.any(axis=0), within.argmax(axis=0), table.argmin(axis=0))
    error = jnp.take_along_axis(table, index[None], axis=0)[0]
    return Choice(index, error, within.any(axis=0), settings)


def _choose_rtol(given: tuple, tolerance: float) -> Choice:
    """Choose the tolerance of the batch by a trial: no closed form predicts driven motion."""
    within = respond_within(*given, tolerance=tolerance)
    bits = int(jnp.finfo(within.response.margin.dtype).bits)
    levels = np.array(TOLERANCES[bits])
    # Tolerances fall: the number of those above the cheapest is its place among them.
    index = jnp.asarray((np.asarray(within.cheapest)[..., None] < levels).sum(axis=-1))
    # The trial shows that a looser tolerance is good enough, but not by how much.
    error = jnp.where(within.cheapest > within.rtol, tolerance, within.error)
    settings = tuple(Setting("batch", bits, level) for level in levels.tolist())
    return Choice(index, error, within.within_tolerance, settings)
