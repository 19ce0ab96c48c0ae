"""Calls that are refused, one of each kind: tables/refusals/*.txt.

A line of a table is a call and, after `->`, what the message must contain, in pieces that `…`
separates. The error is a ValueError, unless another class stands first. Other lines are
headings and the names that the calls of the table use, beside all that is imported here. A run
in float32 leaves the table `float64` out.
"""
# ruff: noqa: F401

import builtins
import functools
import re
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import astropy.units
import equinox as eqx
import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
import xarray
from references.half_sine_rates import pulses
from scenes import impact_times, suite

import jaxrock as jr
from jaxrock.driven import require_complete
from jaxrock.ground_motion import Motion
from jaxrock.validation import as_real, check_increasing

TABLES = Path(__file__).parent / "tables" / "refusals"


class OtherMotion(Motion):
    """A motion that users write."""

    start: jax.Array
    name = "other"
    end = intensity = value = knots = next_kink = scaled = None


class OtherModel(jr.Nonlinear):
    """Another one."""


IMPORTED = dict(globals())


@functools.cache
def read_table(table):
    """Read the definitions and the refused calls; further lines of each are indented."""
    text = (TABLES / f"{table}.txt").read_text(encoding="utf-8")
    lines = [line for line in re.sub(r"\n +", " ", text).splitlines() if line]
    definitions = [line for line in lines if re.match(r"\w+ = ", line)]
    calls = [line for line in lines if " -> " in line and line not in definitions]
    others = {*lines} - {*definitions} - {*calls}
    assert all(line.startswith("# ") for line in others), others
    return definitions, calls


@functools.cache
def evaluate_definitions(table):
    names = dict(IMPORTED)
    exec("\n".join(read_table(table)[0]), names)
    return names


REFUSALS = [
    pytest.param(
        path.stem, line, id=line[:60], marks=[pytest.mark.float64] * (path.stem == "float64")
    )
    for path in sorted(TABLES.glob("*.txt"))
    for line in read_table(path.stem)[1]
]


@pytest.mark.parametrize(("table", "line"), REFUSALS)
def test_a_refused_call_says_what_is_wrong(table, line, monkeypatch):
    # Without the types that the tests check, which would answer before the package does.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    call, _, expected = line.rpartition(" -> ")
    kind, _, pieces = expected.rpartition("Error: ")
    with pytest.raises(getattr(builtins, f"{kind or 'Value'}Error")) as raised:
        eval(call, evaluate_definitions(table))
    message = str(raised.value)
    assert len(message) <= 200
    assert [piece for piece in pieces.split(" … ") if piece not in message] == [], message
