"""The paper regenerated; each comparison is also broken once, to see that it notices."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import jaxrock as jr
from jaxrock.plot import plot_curves
from jaxrock.reports import paper

pytestmark = pytest.mark.float64


@pytest.fixture(scope="module")
def report():
    return paper.regenerate()


def test_nothing_disagrees_but_the_known_fault(report):
    assert report.mismatches == []
    disagreeing = [entry for entry in report.entries if not entry.agrees]
    assert [(entry.table, entry.row, entry.printed) for entry in disagreeing] == [
        ("III", "C = 0.9", "182.37")
    ]
    assert math.isnan(disagreeing[0].computed)


def test_everything_printed_is_compared(report):
    by_table = [entry.table for entry in report.entries]
    assert (by_table.count("I"), by_table.count("II"), by_table.count("III")) == (20, 24, 50)
    zeta = {e.row: e for e in report.entries if e.quantity.startswith("rocking")}
    assert all(zeta[f"C = {c}"].agrees for c in (0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85))
    psi = [e for e in report.entries if "amplification, Eqs. 18" in e.quantity]
    assert len(psi) == 10
    assert all(entry.agrees for entry in psi)
    assert (len(report.claims), len(report.faults)) == (10, 6)
    assert all(finding.figure for finding in (*report.claims, *report.faults))


def test_the_nonlinear_model_stands_beside_the_blocks(report):
    for entry in report.entries:
        if entry.table in ("I", "II") and entry.row != "all":
            assert 0 < entry.nonlinear / entry.computed - 1 < 0.02


@pytest.mark.parametrize(
    ("printed", "computed", "agrees"),
    [
        ("3.83e-3", 0.0038349, True),
        ("3.83e-3", 0.0038351, False),
        ("0.1530", 0.15304, True),
        ("0.1530", 0.15306, False),
        ("inf", math.inf, True),
        ("inf", 1e9, False),
        ("overturning", math.nan, True),
        ("overturning", 40.0, False),
    ],
)
def test_agreement_to_the_digits_printed(printed, computed, agrees):
    entry = paper.Entry("I", "", "", "", printed, computed, math.nan)
    assert entry.agrees == agrees


def test_mismatches_are_named(report):
    wrong = replace(report.entries[0], computed=1.0)
    healed = replace(next(e for e in report.entries if e.fault), computed=182.37)
    claim = replace(report.claims[0], verdict="not confirmed")
    spoiled = paper.Report([wrong, healed], [claim], report.faults)
    assert len(spoiled.mismatches) == 3
    assert spoiled.mismatches[0].startswith("Table I, peak rotation")


@pytest.mark.parametrize("bounds", [[None, 1.4], [3.1, None], [[None, None], [None, 2.9]]])
def test_a_number_out_of_its_bounds_is_noticed(bounds):
    row = {
        "where": "",
        "statement": "",
        "verdict": "holds",
        "figure": "{pair[1]:.2f}",
        "within": {"pair": [1, None]},
    }
    numbers = {"pair": np.array([1.5, 3.0])}
    assert paper.judge(row, numbers) == paper.Finding("", "", "holds", "3.00")
    spoiled = paper.judge(row | {"within": {"pair": bounds}}, numbers)
    missing = paper.judge(row, {"pair": np.array([1.5, np.nan])})
    assert {spoiled.verdict, missing.verdict} == {"not confirmed"}
    # The same bounds are a limit, which numbers within them would not need.
    assert paper.judge(row | {"limited": {"pair": bounds}}, numbers).verdict == "holds"
    unlimited = paper.judge(row | {"limited": {"pair": [1, None]}}, numbers)
    assert unlimited.verdict == "not confirmed"


def test_how_far_claims_hold(report):
    """Each verdict with a limit has a number that says why, computed here by other ways."""
    verdicts = {claim.where: claim.verdict for claim in report.claims}
    limited = {"Fig. 3", "Fig. 4", "Figs. 6 to 8"}
    assert {w for w, verdict in verdicts.items() if verdict == "holds for C <= 0.6"} == limited
    assert {w for w, verdict in verdicts.items() if "Eq. 13" in verdict} == {"Table III"}
    figures = {claim.where: claim.figure for claim in report.claims}

    def scene_of(slenderness, width, restitution):
        return jr.Scene(jr.Block(width / 2, slenderness), restitution, 0.15)

    for restitution in (0.6, 0.7):
        narrow, wide = (
            jr.stabilized_period(scene_of(10.0, w, restitution)) for w in (0.4, 1.2)
        )
        assert f"{100 * (narrow / wide - 1):.0f} % at C = {restitution}" in figures["Fig. 3"]
        stocky, slender = (
            jr.amplification(scene_of(s, 0.4, restitution)) for s in (3.0, 10.0)
        )
        effect = 100 * (slender / stocky - 1)
        assert f"{effect:.0f} % at C = {restitution}" in figures["Fig. 4"]
    restitution = math.exp(-0.05 / (2 * 0.34))  # of -0.34 ln(C squared)
    assert f"{restitution:.3f}" in figures["Table III"]
    assert float(jr.overturning_margin(scene_of(4.0, 1.2, restitution))) < 0


@pytest.mark.thorough
def test_files(report, tmp_path):
    paper.write(report, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(paper.FILES)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "93 of 94 printed numbers agree" in text
    assert "Claims in words (holds: 6, holds for C <= 0.6: 3, rests on Eq. 13: 1)" in text
    assert "known faults (reproduced: 6)" in text
    assert text.count("| **no**") == 1
    figures = [name.removesuffix(".png") for name in paper.FILES if name.endswith(".png")]
    assert figures[:2] == ["figure_1", "figure_2"]
    assert all(f"]({name}.png)" in text for name in figures)
    assert len((tmp_path / "table_3.csv").read_text(encoding="utf-8").splitlines()) == 51
    for name in paper.FILES:
        if name.endswith(".png"):
            assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_figures_end_where_blocks_overturn():
    drawn = paper.select_figures()
    assert set(drawn) == {f"figure_{n}" for n in ("3", "4a", "4b", "5", "6", "7", "8")}
    ratio = drawn["figure_8"][0].sel(width=0.6)
    last = float(ratio.slenderness[ratio.notnull().values][-1])
    assert 7.0 < last < 7.1
    assert drawn["figure_6"][0].notnull().all()
    small, large = (drawn[f"figure_{n}"][0].sel(restitution=0.7) for n in ("4a", "4b"))
    assert float(small[-1]) == pytest.approx(17.694, abs=1e-3)
    assert float(large[-1]) == pytest.approx(12.076, abs=1e-3)


def test_picture_and_report_print_the_same_thresholds(report):
    """Rounded from where the block falls, and not from the grid on which curves are drawn."""
    (claim,) = [each for each in report.claims if each.where == "Fig. 8"]
    printed = re.findall(r"([\d.]+) \(([\d.]+) m\)", claim.figure)
    assert [float(width) for _, width in printed] == [0.4, 0.6, 0.8, 1.0, 1.2]
    for limit, width in printed:
        unit = 10.0 ** -len(limit.partition(".")[2])
        slenderness = float(limit) + unit * np.array([-0.51, 0.51])
        scene = jr.Scene(jr.Block(float(width) / 2, slenderness), 0.8, 0.15)
        assert np.isnan(jr.rotation_ratio(scene)).tolist() == [False, True]
    variable, hue, _ = paper.select_figures()["figure_8"]
    thresholds = paper._find_thresholds(variable)
    ax = plot_curves(variable, hue, thresholds=thresholds)
    texts = [text.get_text() for text in ax.texts]
    assert texts == [limit for limit, _ in printed][: len(texts)] == ["4.82", "7.09", "9.39"]
    # The same block in Fig. 5, in which curves are of restitutions.
    variable, hue, _ = paper.select_figures()["figure_5"]
    ax = plot_curves(variable, hue, thresholds=paper._find_thresholds(variable))
    assert [text.get_text() for text in ax.texts] == ["9.39"]
