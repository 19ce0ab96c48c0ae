"""Suites of records: their measures, what is computed with them, and their files."""

import csv
import io
import zipfile
from fractions import Fraction
from importlib.resources import files
from itertools import pairwise

import hypothesis
import hypothesis.strategies as st
import jax
import numpy as np
import pytest

import jaxrock as jr
from jaxrock.ground_motion import intensity_measure

G = 9.80665
BLOCK = jr.Block(0.2, 5.0)
BLOCKS = jr.Block(np.array([0.2, 0.4]), np.array([5.0, 4.0]))


def shaking(samples, step, cycles, upward=False):
    """A few cycles that swell and die away, of up to 4 m/s2."""
    along = np.linspace(0, 1, samples)
    envelope = 4 * np.sin(np.pi * along)
    vertical = 0.5 * envelope * np.sin(9 * np.pi * along) if upward else None
    return jr.Record(envelope * np.sin(2 * np.pi * cycles * along), step, vertical)


SHORT = jr.Suite([shaking(120, 0.02, 3), shaking(200, 0.015, 4)])  # padded as they are alone
# Here the second one is padded further than alone, because of the third.
LONGER = shaking(300, 0.01, 4, upward=True), shaking(600, 0.005, 5)
SUITE = jr.Suite([SHORT[0], *LONGER], ["a", "b", "c"])


def exact_peaks(samples, step):
    """PGA and PGV of lines between samples, from rest on."""
    velocity = Fraction(0)
    fastest = Fraction(0)
    for before, after in pairwise(map(Fraction, samples)):
        if before * after < 0:
            fastest = max(fastest, abs(velocity + before**2 / (before - after) / 2))
        velocity += (before + after) / 2
        fastest = max(fastest, abs(velocity))
    return float(max(map(abs, map(Fraction, samples)))), float(fastest * Fraction(step))


WHOLE = st.integers(-20, 20).map(float)


@hypothesis.given(st.lists(WHOLE, min_size=2, max_size=30), st.sampled_from([1.0, -2.5, 0.0]))
@hypothesis.example([float(n * 7 % 11 - 4) for n in range(257)], -2.0)
def test_peaks_against_exact_arithmetic(samples, scale):
    record = jr.Record(np.array(samples), 0.01, scale=scale)
    eps = float(np.finfo(record.acceleration.dtype).eps)
    expected = exact_peaks(samples, float(record.time_step))
    for measure, peak in zip(("pga", "pgv"), expected, strict=True):
        found = float(intensity_measure(record, measure))
        assert found == pytest.approx(abs(scale) * peak, rel=16 * eps), measure


def test_measures_have_the_shape_of_scale_and_block(eps):
    record = shaking(50, 0.02, 2).scaled(np.array([[1.0], [-2.0], [0.0]]))
    for measure in ("pga", "pgv"):
        value = np.asarray(intensity_measure(record, measure))
        assert value.shape == (3, 1)
        np.testing.assert_allclose(value[:, 0], value[0] * [1, 2, 0], rtol=4 * eps)
        blocks = jr.Block(np.array([[0.2, 0.4]]), np.array([[5.0, 4.0]]))
        uplift = 9.81 / np.array([5.0, 4.0])  # g tan(alpha_c)
        frequency = np.asarray(blocks.frequency_parameter) if measure == "pgv" else 1.0
        ratio = intensity_measure(record, f"{measure}_ratio", blocks)
        np.testing.assert_allclose(ratio, value * frequency / uplift, rtol=8 * eps)


ONE = jr.Record(np.array([0.0, 1.0]), 0.1)


def test_a_suite_is_a_sequence():
    assert len(SUITE) == 3
    assert [record.samples for record in SUITE] == [120, 300, 600]
    assert SUITE["b"] is SUITE[1] is SUITE[1:][0]
    assert SUITE[1:].names == ("b", "c")
    assert jr.Suite([ONE, ONE]).names == ("1", "2")
    assert "120 to 600 samples, 0.005 to 0.02 s apart" in str(SUITE)


def test_records_are_scaled_to_levels(eps):
    levels = np.array([0.2, 0.5])
    for measure in ("pga", "pgv_ratio"):
        plain = SUITE.measure(measure, BLOCK)
        each = [intensity_measure(record, measure, BLOCK) for record in SUITE]
        np.testing.assert_array_equal(plain, each)
        scaled = SUITE.scaled(SUITE.factors(levels, measure, BLOCK))
        assert scaled.names == SUITE.names
        reached = scaled.measure(measure, BLOCK)
        np.testing.assert_allclose(reached, np.tile(levels, (3, 1)), rtol=8 * eps)
        turned = SUITE.scaled(np.array([2.0, 0.0, -1.0])).measure(measure, BLOCK)
        np.testing.assert_allclose(turned, plain * np.array([2.0, 0.0, 1.0]), rtol=eps)
    assert SUITE.measure("pgv_ratio", BLOCKS).shape == (3, 2)
    assert SUITE.factors(levels, "pgv_ratio", BLOCKS).shape == (3, 2, 2)


def assert_row(found, k, single, rtol=0.0):
    for rows, theirs in zip(jax.tree.leaves(found), jax.tree.leaves(single), strict=True):
        np.testing.assert_allclose(rows[k], theirs, rtol=rtol)


@pytest.mark.thorough
def test_responses_are_those_of_the_records(eps):
    strong = SUITE.scaled(np.tile([[0.8], [1.5], [3.0]], (3, 1, 1)))
    responses = jr.respond_batch(BLOCKS, 0.8, strong)
    assert 0 < responses.overturned.sum() < 18
    within = jr.respond_within(BLOCKS, 0.8, SHORT, 1e-2, duration=2.0)
    for k, record in enumerate(strong):
        rtol = max(1e-9, 100 * eps) if k == 1 else 0.0
        assert_row(responses, k, jr.respond_batch(BLOCKS, 0.8, record), rtol)
    for k, record in enumerate(SHORT):
        assert_row(within, k, jr.respond_within(BLOCKS, 0.8, record, 1e-2, duration=2.0))


def test_example_suite():
    """Against its index; where it is from and on what terms, GeoNet's attribution included."""
    packed = (files("jaxrock") / "data" / "example_suite.zip").read_bytes()
    assert len(packed) < 0.6e6
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        texts = {name: archive.read(name).decode() for name in archive.namelist()}
    rows = {row["file"]: row for row in csv.DictReader(io.StringIO(texts.pop("index.csv")))}
    assert rows.keys() == texts.keys()
    expected = {}
    for name in sorted(rows):
        head = [line for line in texts[name].splitlines() if line.startswith("#")]
        for word in ("Licence: ", "Source: "):
            assert any(word in line for line in head), (name, word)
        if "GeoNet" in rows[name]["network"]:
            assert "GeoNet programme and its sponsors EQC, GNS Science, LINZ" in "".join(head)
        for which in ("first", "second"):
            expected[f"{name}, {which}"] = G * float(rows[name][f"pga_g_{which}"])
    assert sum("kaikoura" in name for name in expected) == 4
    suite = jr.example_suite(vertical=True)
    assert len(suite) == 20
    np.testing.assert_allclose(suite.measure("pga"), [*expected.values()], rtol=1e-3)
    assert all(record.vertical is not None for record in suite)
