"""Objects that stand free: their names, sizes and impacts."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block, size_of
from ..host import Printed, format_table
from ..sensitivity import Uncertain
from ..validation import Numbers, Reals, as_real, as_text
from .objects import Objects, gather_objects


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
    uncertain : Uncertain, optional
        Uncertain parameters, with one coefficient of variation for all objects or one for
        each.
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
                             width [m]    height [m]   restitution
    vase                           0.2           0.6          0.85
    bust                           0.3           0.9          0.85
    """

    names: tuple[str, ...] = eqx.field(static=True)
    block: Block
    restitution: Reals
    uncertain: Uncertain | None = eqx.field(static=True)
    remarks: tuple[str, ...] = eqx.field(static=True)

    def __init__(
        self,
        names: Sequence[str],
        block: Block,
        restitution: Numbers,
        uncertain: Uncertain | None = None,
        remarks: Sequence[str] | None = None,
    ):
        objects = gather_objects(block, as_real("restitution", restitution, unit=""), names)
        if uncertain is not None:
            # What cannot be drawn is refused here, before anything is computed. Whether the
            # objects are on a floor is known to a site.
            uncertain.draw(objects.block, objects.restitution, on_floor=True)
        remarks = [""] * objects.number if remarks is None else remarks
        if len(remarks) != objects.number:
            raise ValueError(
                f"remarks must be one for each of {objects.number} objects, got {len(remarks)}"
            )
        self.names = objects.names
        self.block = jax.device_put(objects.block)
        self.restitution = jnp.asarray(objects.restitution)
        self.uncertain = uncertain
        self.remarks = tuple(map(as_text, remarks))

    def __len__(self) -> int:
        return len(self.names)

    def __str__(self) -> str:
        sizes = size_of(self.objects.block, "sides")
        columns = {
            "width [m]": sizes["width"],
            "height [m]": sizes["height"],
            "restitution": np.asarray(self.restitution),
        }
        first = f"{len(self)} object{'s' * (len(self) > 1)}"
        table = format_table(first, [name[:19] for name in self.names], **columns)
        return table if self.uncertain is None else f"{table}\n{self.uncertain}"

    @property
    def objects(self) -> Objects:
        """The objects, in NumPy."""
        block, restitution = jax.tree.map(np.asarray, (self.block, self.restitution))
        return Objects(block, restitution, restitution.shape, self.names)
