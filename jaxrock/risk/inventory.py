"""Objects that stand free: their names, sizes and impacts."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..host import Printed, format_table
from ..sensitivity import Uncertain
from ..validation import Numbers, Reals, as_real
from .objects import gather_objects


class Inventory(Printed, eqx.Module):
    """Objects that stand free: their names, sizes and impacts; see `read_inventory`.

    Parameters
    ----------
    names : sequence of str
        One for each object, different from each other.
    block : Block
        Of shape (objects,).
    restitution : array_like
        C [-], between 0 and 1; one, or one for each object.
    restitution_scatter : array_like
        Coefficient of variation of each C, where it is uncertain; 0 where it is not.
    remarks : sequence of str, optional
        What was assumed for each object.

    Raises
    ------
    ValueError
        If names are not one different word for each object, if shapes do not fit, or a value
        is out of range.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import jaxrock as jr
    >>> width = jnp.array([0.2, 0.3])
    >>> block = jr.Block.from_size(width=width, height=3 * width)
    >>> print(jr.risk.Inventory(["vase", "bust"], block, restitution=0.85))
    2 objects
                             width [m]    height [m]   restitution       scatter
    vase                           0.2           0.6          0.85             0
    bust                           0.3           0.9          0.85             0
    """

    names: tuple[str, ...] = eqx.field(static=True)
    block: Block
    restitution: Reals
    restitution_scatter: Reals
    remarks: tuple[str, ...] = eqx.field(static=True)

    def __init__(
        self,
        names: Sequence[str],
        block: Block,
        restitution: Numbers,
        restitution_scatter: Numbers = 0.0,
        remarks: Sequence[str] | None = None,
    ):
        objects = gather_objects(block, as_real("restitution", restitution), names)
        number = objects.number
        scatter = np.asarray(as_real("restitution_scatter", restitution_scatter))
        if scatter.shape not in ((), (number,)):
            must = f"restitution_scatter must be one, or one for each of {number} objects"
            raise ValueError(f"{must}, got shape {scatter.shape}")
        scatter = np.broadcast_to(scatter, (number,))
        for c, variation in zip(objects.restitution, scatter, strict=True):
            check_scatter(float(c), float(variation))
        remarks = [""] * number if remarks is None else remarks
        if len(remarks) != number:
            got = f"got {len(remarks)}"
            raise ValueError(f"remarks must be one for each of {number} objects, {got}")
        self.names = objects.names
        self.block = jax.device_put(objects.block)
        self.restitution = jnp.asarray(objects.restitution)
        self.restitution_scatter = jnp.asarray(scatter)
        self.remarks = tuple(remarks)

    def __len__(self) -> int:
        return len(self.names)

    def __str__(self) -> str:
        columns = {
            "width [m]": 2 * np.asarray(self.block.half_width),
            "height [m]": 2 * np.asarray(self.block.half_width * self.block.slenderness),
            "restitution": np.asarray(self.restitution),
            "scatter": np.asarray(self.restitution_scatter),
        }
        number = len(self)
        first = f"{number} object{'s' * (number > 1)}"
        return format_table(first, [name[:19] for name in self.names], **columns)


def check_scatter(restitution: float, scatter: float) -> None:
    """Raise `ValueError` if a restitution cannot scatter that much."""
    Uncertain({"restitution": scatter}, samples=1).draw(Block(1.0, 1.0), restitution)
