"""Calls that are refused, one of each kind: tables/refusals/*.txt.

A line of a table is a call and, after `->`, what the message must contain, in pieces that `…`
separates. The error is a ValueError, unless another class stands first. Other lines are
headings and the names that the calls of the table use, beside all that is imported here. A run
in float32 leaves the table `float64` out.
"""
# ruff: noqa: F401

import builtins
import re
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import astropy.units
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
from jaxrock.validation import check_increasing

TABLES = sorted((Path(__file__).parent / "tables" / "refusals").glob("*.txt"))


def read_table(path):
    """Read the definitions and the refused calls; further lines of each are indented."""
    text = re.sub(r"\n +", " ", path.read_text(encoding="utf-8"))
    lines = [line for line in text.splitlines() if line and not line.startswith("# ")]
    definitions = [line for line in lines if re.match(r"\w+ = ", line)]
    calls = [line.rpartition(" -> ") for line in lines if line not in definitions]
    return definitions, [(call, expected) for call, _, expected in calls]


def find_fault(call, expected, names):
    """How a call fails to be refused in the words that are expected; empty if it is."""
    kind, _, pieces = expected.rpartition("Error: ")
    try:
        eval(call, names)
    except Exception as error:
        message = str(error)
        is_kind = isinstance(error, getattr(builtins, f"{kind or 'Value'}Error"))
        is_said = all(piece in message for piece in pieces.split(" … "))
        is_short = len(message) <= 200
        return "" if is_kind and is_said and is_short else f"{call} raises {error!r}"
    return f"{call} is not refused"


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(
            path, id=path.stem, marks=[pytest.mark.float64] * (path.stem == "float64")
        )
        for path in TABLES
    ],
)
def test_refused_calls_say_what_is_wrong(path, monkeypatch):
    # Without the types that the tests check, which would answer before the package does.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    definitions, calls = read_table(path)
    names = dict(globals())
    exec("\n".join(definitions), names)
    faults = [find_fault(call, expected, names) for call, expected in calls]
    assert [fault for fault in faults if fault] == []
