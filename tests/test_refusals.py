"""Calls that are refused, and the sentence each is refused with: tables/refusals/*.txt.

A table has headings (`# The half-cycle map`), names that the calls below them use (`BLOCK = ...`),
and calls with, after `->`, their sentences. `…` stands for whatever may differ. The error is a
ValueError, unless the sentence names another class first. A heading that ends with "in float64"
leaves its calls out of a run in float32.
"""

import builtins
import functools
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import astropy.units
import equinox as eqx
import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pint
import pytest
import xarray
from references.half_sine_rates import hazard, pulses
from scenes import GRID, impact_times, suite

import jaxrock as jr
from jaxrock.driven import require_complete
from jaxrock.ground_motion import Motion
from jaxrock.validation import as_real, check_increasing

TABLES = Path(__file__).parent / "tables" / "refusals"
ENTRY = re.compile(
    r"# (?P<heading>.+)"
    r"|(?P<name>\w+) = (?P<value>.+(?:\n[ )}].*)*)"
    r"|(?P<call>.+?(?:\n(?!->).+)*?)(?: |\n)-> (?P<sentence>.+(?:\n   .+)*)"
)


class Quantity(float):
    """As pint, astropy and unyt have them."""

    units = "centimeter"

    def __repr__(self):
        return f"{float(self)} {self.units}"


class OtherMotion(Motion):
    """A motion that users write."""

    start: jax.Array
    name = "other"
    end = intensity = value = knots = next_kink = scaled = None


class OtherModel(jr.Nonlinear):
    """A model of free rocking that users write."""


# What all tables use.
NAMES = {
    "jr": jr,
    "jax": jax,
    "jnp": jnp,
    "np": np,
    "astropy": astropy,
    "eqx": eqx,
    "pint": pint,
    "xarray": xarray,
    "partial": partial,
    "SimpleNamespace": SimpleNamespace,
    "GRID": GRID,
    "impact_times": impact_times,
    "suite": suite,
    "hazard": hazard,
    "pulses": pulses,
    "OtherModel": OtherModel,
    "OtherMotion": OtherMotion,
    "Quantity": Quantity,
    "as_real": as_real,
    "check_increasing": check_increasing,
    "require_complete": require_complete,
}


@dataclass
class Refusal:
    """A call as it is written, the names that it uses, and its sentence."""

    table: str
    heading: str
    call: str
    sentence: str
    definitions: tuple

    def __str__(self):
        return f"{self.table}-{' '.join(self.call.split())[:60]}"

    def ask(self):
        return eval(f"({self.call}\n)", dict(evaluate(self.definitions)))


@functools.cache  # many calls have the same ones
def evaluate(definitions):
    names = dict(NAMES)
    for name, value in definitions:
        names[name] = eval(f"({value}\n)", names)
    return names


def read_refusals():
    for path in sorted(TABLES.glob("*.txt")):
        heading = ""
        definitions = ()
        text = path.read_text(encoding="utf-8")
        for entry in ENTRY.finditer(text):
            if entry["heading"]:
                heading = entry["heading"]
                definitions = ()
            elif entry["name"]:
                definitions += ((entry["name"], entry["value"]),)
            else:
                sentence = re.sub(r"\n +", " ", entry["sentence"])
                yield Refusal(path.stem, heading, entry["call"], sentence, definitions)
        assert not ENTRY.sub("", text).strip(), f"{path.name}: {ENTRY.sub('', text).strip()}"


REFUSALS = [
    pytest.param(refusal, marks=[pytest.mark.float64] * refusal.heading.endswith("in float64"))
    for refusal in read_refusals()
]


@pytest.fixture
def as_users_have_it(monkeypatch):
    """Without the types that the tests check, which would answer before the package does."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


def round_numbers(sentence):
    """Write numbers with four digits, since float32 prints 0.4 as 0.400000006."""
    return re.sub(r"\d+\.\d{4,}", lambda number: f"{float(number[0]):.4g}", sentence)


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize("refusal", REFUSALS, ids=str)
def test_a_call_is_refused_in_one_sentence(refusal):
    kind, _, sentence = refusal.sentence.rpartition("Error: ")
    with pytest.raises(getattr(builtins, f"{kind or 'Value'}Error")) as raised:
        refusal.ask()
    assert len(str(raised.value)) <= 200
    pattern = re.escape(round_numbers(sentence)).replace("…", ".*")
    assert re.fullmatch(pattern, round_numbers(str(raised.value))), str(raised.value)
