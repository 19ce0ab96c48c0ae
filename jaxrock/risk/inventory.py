"""Objects to be protected: their names, sizes and impacts, and where they stand."""

from collections.abc import Iterable, Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block, block_of, size_of
from ..ground_motion import FLOOR_DAMPING
from ..host import Printed, format_table
from ..sensitivity import Uncertain
from ..validation import (
    NON_NEGATIVE,
    UNIT_INTERVAL,
    Domain,
    Numbers,
    Reals,
    as_real,
    as_text,
    check,
    check_kind,
    describe,
)
from .objects import Objects, gather_objects


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
        Uncertain parameters, with one coefficient of variation for all objects or one for
        each.
    remarks : sequence of str, optional
        What is exceptional about each object.
    one_sided : bool or sequence of bool, optional
        Whether an object stands against a wall; see `Block`. One value, or one for each
        object; by default that of the block.
    floor_period : array_like
        Period of the floor on which an object stands [s], finite and at least 0: 0 is the
        ground floor, which moves with the ground. One, or one for each object.
    floor_damping : array_like, optional
        Damping ratio of that floor [-], between 0 and 1; one, or one for each object. It is
        0.05 by default, and does not count on the ground floor.
    restitution_assumed : bool or sequence of bool
        Whether the restitution was not given and follows from size; then rates are computed
        for a lower one as well. One, or one for each object.
    others : mapping of str to sequence of str, optional
        What else is known of each object, in words, such as its inventory number.

    Attributes
    ----------
    block : Block
        One-sided if all objects are.
    one_sided, restitution_assumed : tuple of bool
        One for each object.
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
    one_sided: tuple[bool, ...] = eqx.field(static=True)
    floor_period: Reals
    floor_damping: Reals
    restitution_assumed: tuple[bool, ...] = eqx.field(static=True)
    others: tuple[tuple[str, tuple[str, ...]], ...] = eqx.field(static=True)

    def __init__(  # noqa: PLR0913
        self,
        names: Sequence[str],
        block: Block,
        restitution: Numbers,
        uncertain: Uncertain | None = None,
        remarks: Sequence[str] | None = None,
        *,
        one_sided: bool | Sequence[bool] | None = None,
        floor_period: Numbers = 0.0,
        floor_damping: Numbers | None = None,
        restitution_assumed: bool | Sequence[bool] = False,
        others: Mapping[str, Sequence[str]] | None = None,
    ):
        check_kind("block", block, Block)
        kinds = _read_flags("one_sided", block.one_sided if one_sided is None else one_sided)
        coefficient = as_real("restitution", restitution, unit="")
        # Of one-sided objects magnitudes are taken; all others have to be positive.
        objects = gather_objects(_as_kind(block, bool(kinds.any())), coefficient, names)
        kinds = _give_each("one_sided", kinds, objects.number)
        check("restitution", np.where(kinds, 0, coefficient), UNIT_INTERVAL)
        objects = objects._replace(block=_as_kind(objects.block, bool(kinds.all())))
        period = _read_each("floor_period", floor_period, "s", NON_NEGATIVE, objects.number)
        if floor_damping is not None and not period.any():
            raise ValueError(
                "floor_damping goes with a floor_period greater than 0, got"
                f" {describe(floor_damping)} without one"
            )
        damping = FLOOR_DAMPING if floor_damping is None else floor_damping
        damping = _read_each("floor_damping", damping, "", UNIT_INTERVAL, objects.number)
        if uncertain is not None:
            # What cannot be drawn is refused here, before anything is computed. Whether the
            # objects are on a floor is known to a site.
            uncertain.draw(objects.block, objects.restitution, on_floor=True)
        remarks = [""] * objects.number if remarks is None else remarks
        others = others or {}
        for name, words in {"remarks": remarks, **others}.items():
            if len(words) != objects.number:
                raise ValueError(
                    f"{name} must be one for each of {objects.number} objects, got {len(words)}"
                )
        self.names = objects.names
        self.block = jax.device_put(objects.block)
        self.restitution = jnp.asarray(objects.restitution)
        self.uncertain = uncertain
        self.remarks = tuple(map(as_text, remarks))
        self.one_sided = tuple(kinds.tolist())
        self.floor_period = jax.device_put(period)
        self.floor_damping = jax.device_put(damping)
        assumed = _read_flags("restitution_assumed", restitution_assumed)
        assumed = _give_each("restitution_assumed", assumed, objects.number)
        self.restitution_assumed = tuple(assumed.tolist())
        self.others = tuple((name, tuple(words)) for name, words in others.items())

    def __len__(self) -> int:
        return len(self.names)

    def __str__(self) -> str:
        sizes = size_of(self.objects.block, "sides")
        columns: dict[str, Iterable[object]] = {
            "width [m]": np.asarray(sizes["width"]),
            "height [m]": np.asarray(sizes["height"]),
            "restitution": np.asarray(self.restitution),
        }
        if any(self.one_sided):
            columns["one-sided"] = ["yes" if kind else "no" for kind in self.one_sided]
        periods = np.asarray(self.floor_period)
        if periods.any():
            columns["floor [s]"] = periods
        first = f"{len(self)} object{'s' * (len(self) > 1)}"
        table = format_table(first, [name[:19] for name in self.names], **columns)
        return table if self.uncertain is None else f"{table}\n{self.uncertain}"

    @property
    def objects(self) -> Objects:
        """The objects, in NumPy."""
        block, restitution = jax.tree.map(np.asarray, (self.block, self.restitution))
        return Objects(block, restitution, restitution.shape, self.names)


def _read_flags(name: str, flags: bool | Sequence[bool]) -> np.ndarray:
    """Read what holds for objects or not; a `ValueError` for anything but True and False."""
    values = np.asarray(flags)
    if values.dtype != bool or values.ndim > 1:
        raise ValueError(
            f"{name} must be True or False, or one of them for each object, got"
            f" {describe(flags)}"
        )
    return values


def _as_kind(block: Block, one_sided: bool) -> Block:
    """Return a block of the same numbers that is one-sided, or free-standing."""
    if block.one_sided == one_sided:
        return block
    return block_of(size_of(block, "shape"), one_sided)


def _read_each(
    name: str, value: Numbers, unit: str, domain: Domain, number: int
) -> np.ndarray:
    """Read a number for each object; a `ValueError` if one is not allowed."""
    values = as_real(name, value, unit=unit)
    check(name, values, domain)
    return _give_each(name, np.asarray(values), number)


def _give_each(name: str, values: np.ndarray, number: int) -> np.ndarray:
    """Give each object a value; a `ValueError` if there are more or fewer."""
    if values.shape not in ((), (number,)):
        raise ValueError(
            f"{name} must be one, or one for each of {number} objects, got an array of shape"
            f" {values.shape}"
        )
    return np.broadcast_to(values, (number,))
