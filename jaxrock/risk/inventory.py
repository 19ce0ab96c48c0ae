"""Objects to be protected: their names, sizes and impacts, and where they stand."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block, block_of, size_of
from ..ground_motion import FLOOR_DAMPING, FLOOR_PERIOD
from ..host import Printed
from ..sensitivity import Uncertain
from ..validation import (
    BELOW_ONE,
    UNIT_INTERVAL,
    Booleans,
    Domain,
    Numbers,
    Reals,
    as_real,
    check,
    check_kind,
    check_shapes,
)
from .objects import gather_objects


class Inventory(Printed, eqx.Module):
    """Objects: their names, sizes and impacts, and where they stand; see `read_inventory`.

    Parameters
    ----------
    names : sequence of str
        A different name for each object.
    block : Block
        Of shape (objects,).
    restitution : array_like
        C [-], between 0 and 1; one, or one for each object. For a one-sided object it may be
        negative; its magnitude counts.
    uncertain : Uncertain, optional
        Uncertain parameters of the objects, with one coefficient of variation for all or one
        for each.
    one_sided : bool or sequence of bool, optional
        Whether an object stands against a wall; see `Block`. One value, or one for each
        object; by default that of the block.
    floor_period : array_like
        Period of the floor on which an object stands [s], from 0 to 20: 0 is the ground floor,
        which moves with the ground. One, or one for each object.
    floor_damping : array_like
        Damping ratio of that floor, between 0 and 1 [-]; one, or one for each object. It does
        not count on the ground floor.
    restitution_assumed : bool or sequence of bool
        Whether the restitution was not given and follows from size; then rates are computed
        for a lower one as well. One, or one for each object.
    others : mapping of str to sequence of str, optional
        What else is known of each object, in words, such as its inventory number.

    Attributes
    ----------
    block : Block
        As if no object stood against a wall; `one_sided` tells which do.
    one_sided, restitution_assumed : Array of bool, shape (objects,)
    floor_period, floor_damping : Array, shape (objects,)
    others : tuple of (str, tuple of str)
        A name, and a word for each object.

    Raises
    ------
    ValueError
        If names are not different words, one for each object, if shapes do not fit, or if a
        value is out of range.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import jaxrock as jr
    >>> width = jnp.array([0.2, 0.3])
    >>> block = jr.Block.from_size(width=width, height=3 * width)
    >>> print(jr.risk.Inventory(["vase", "bust"], block, restitution=0.85))
    2 objects: vase, bust
    """

    names: tuple[str, ...] = eqx.field(static=True)
    block: Block
    restitution: Reals
    uncertain: Uncertain | None = eqx.field(static=True)
    one_sided: Booleans
    floor_period: Reals
    floor_damping: Reals
    restitution_assumed: Booleans
    others: tuple[tuple[str, tuple[str, ...]], ...] = eqx.field(static=True)

    def __init__(  # noqa: PLR0913
        self,
        names: Sequence[str],
        block: Block,
        restitution: Numbers,
        uncertain: Uncertain | None = None,
        *,
        one_sided: bool | Sequence[bool] | None = None,
        floor_period: Numbers = 0.0,
        floor_damping: Numbers = FLOOR_DAMPING,
        restitution_assumed: bool | Sequence[bool] = False,
        others: Mapping[str, Sequence[str]] | None = None,
    ):
        check_kind("block", block, Block)
        walls = np.asarray(block.one_sided if one_sided is None else one_sided)
        # Of one-sided objects magnitudes are taken; all others have to be positive.
        kind = block_of(size_of(block, "shape"), bool(walls.any()))
        read = as_real("restitution", restitution, unit="")
        objects = gather_objects(kind, read)
        number = objects[1].size
        self.names = tuple(map(str, names))
        if len({*names}) != len(names) or objects[1].shape != (len(names),):
            raise ValueError(
                f"names must differ, one for each of {number} objects, got {names!r:.60}"
            )
        check("restitution", np.where(walls, 0, read), UNIT_INTERVAL)
        self.block = jax.device_put(block_of(size_of(objects[0], "shape"), False))
        self.restitution = jnp.asarray(objects[1])
        self.one_sided = _spread("one_sided", walls, number)
        self.restitution_assumed = _spread("restitution_assumed", restitution_assumed, number)
        self.floor_period = _spread("floor_period", floor_period, number, FLOOR_PERIOD)
        self.floor_damping = _spread("floor_damping", floor_damping, number, BELOW_ONE)
        if uncertain is not None:
            # What cannot be drawn is refused here, before anything is computed.
            uncertain.draw(*objects)
        self.uncertain = uncertain
        self.others = tuple((name, tuple(texts)) for name, texts in (others or {}).items())

    def __len__(self) -> int:
        return len(self.names)

    def __str__(self) -> str:
        listed = ", ".join(self.names[:5]) + ", ..." * (len(self) > 5)
        return f"{len(self)} object{'s' * (len(self) > 1)}: {listed}"


def _spread(name: str, value: Any, number: int, domain: Domain | None = None) -> jax.Array:
    """Give each object a value: numbers of a domain, or without one True and False."""
    values = np.asarray(value, bool) if domain is None else np.asarray(as_real(name, value))
    if domain is not None:
        check(name, values, domain)
    check_shapes(**{name: values, "names": np.zeros(number)})
    return jax.device_put(np.broadcast_to(values, (number,)))
