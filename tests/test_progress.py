"""What takes long shows how far it is: a bar on a terminal, elsewhere messages."""

import io
import itertools
import logging
import re
import time
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

import jaxrock as jr
from jaxrock.host import (
    announce,
    count_work,
    hide_progress,
    name_work,
    progress,
    show_progress,
)


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(progress, "_SHORT", 0.0)
    monkeypatch.setattr(progress, "_MOMENT", 0.0)
    monkeypatch.setattr(progress, "_LONG", 0.02)
    monkeypatch.setattr(progress, "_BETWEEN", 0.0)


@pytest.fixture
def messages(quick, monkeypatch, caplog):
    """Messages for who asks for them, without a terminal."""
    monkeypatch.setattr("sys.stderr", io.StringIO())
    with caplog.at_level(logging.INFO, "jaxrock"):
        yield caplog


def loop():
    """Go through a loop that takes a while; what it went through."""
    items = []
    for item in show_progress(range(4), "steps"):
        time.sleep(0.01)
        items.append(item)
    return items


def read_percents(text, label):
    return [int(percent) for percent in re.findall(rf"{label}: +(\d+) ?%", text)]


def check_percents(percents, number):
    """Check that there are so many, that they increase and come to an end."""
    assert len(percents) >= number, percents
    assert percents == sorted(percents)
    assert max(np.diff([0, *percents, 100])) <= 50, percents


def test_a_bar_on_a_terminal(quick, monkeypatch, caplog):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with caplog.at_level(logging.INFO, "jaxrock"):
        assert loop() == [0, 1, 2, 3]
    assert read_percents(terminal.getvalue(), "steps") == [0, 25, 50, 75, 100]
    assert caplog.messages == []


@pytest.mark.parametrize("stderr", [io.StringIO(), None])
def test_messages_elsewhere(quick, monkeypatch, caplog, stderr):
    """Which nobody sees who has not asked for messages."""
    monkeypatch.setattr("sys.stderr", stderr)
    with caplog.at_level(logging.INFO, "jaxrock"):
        assert loop() == [0, 1, 2, 3]
        announce("timing takes some 6 s")
    assert caplog.messages == [
        "steps: 25 % after 0 s",
        "steps: 50 % after 0 s",
        "steps: 75 % after 0 s",
        "steps: done in 0 s",
        "timing takes some 6 s",
    ]
    caplog.clear()
    loop()
    assert caplog.messages == []
    assert stderr is None or stderr.getvalue() == ""


def test_messages_come_at_intervals(messages, monkeypatch):
    """Of 10 s, and no two with the same percentage."""
    monkeypatch.setattr(progress, "_BETWEEN", 10.0)
    for amount, percents in ((50, [20, 40, 60, 80]), (2000, [1, 2])):
        messages.clear()
        # A second passes whenever somebody looks.
        clock = itertools.count(0.0)
        monkeypatch.setattr(
            progress, "time", SimpleNamespace(monotonic=lambda c=clock: next(c))
        )
        with count_work("steps", amount) as work:
            for _ in range(50):
                work.advance()
        assert read_percents(messages.text, "steps") == percents


def test_what_is_over_soon_says_nothing(monkeypatch, caplog):
    monkeypatch.setattr("sys.stderr", io.StringIO())
    with caplog.at_level(logging.INFO, "jaxrock"):
        loop()
    assert caplog.messages == []


def test_a_part_of_something_larger_says_nothing(quick, monkeypatch, caplog):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with hide_progress(), caplog.at_level(logging.INFO, "jaxrock"):
        loop()
        with count_work("motions", 2) as work:
            work.advance()
    assert terminal.getvalue() == ""
    assert caplog.messages == []


def test_parts_advance_the_whole_which_may_turn_out_longer(messages):
    with name_work("widths"), count_work("rounds", 10) as work:
        for remaining in (10, 10, 5):
            work.expect(remaining)
            with count_work("motions", 5) as part:
                # What a part expects says nothing of the whole.
                part.expect(1000)
                part.advance(5)
    assert read_percents(messages.text, "widths, rounds") == [50, 75]


def test_a_step_that_fails_is_not_done(messages):
    def fail():
        with count_work("motions", 2):
            time.sleep(0.03)
            raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        fail()
    assert messages.messages == []


def test_motions_are_counted(messages):
    widths = jnp.linspace(0.1, 0.2, 8192)
    jr.respond_batch(jr.Block(widths, 5.0), 0.9, jr.Sine(2.5, 0.5))
    check_percents(read_percents(messages.text, "motions"), 3)


@pytest.mark.thorough
def test_steps_around_a_site_have_names_and_percentages(messages):
    suite = jr.Suite([jr.Record([0.0, a, a, -a, -a, 0.0], 0.1) for a in (3.0, 4.0)])
    site = jr.Site(suite, jr.Hazard([0.4, 4.0], [1e-2, 1e-4]))
    block = jr.Block.from_size(width=jnp.array([0.2, 0.3]), height=1.0)
    jr.required_value(block, 0.8, site, 1e-3, "width", (0.2, 1.0))
    jr.risk.rate_elasticities(block, 0.8, site)
    text = messages.text
    for label, number in (
        ("required width, search for boundaries", 5),
        ("elasticities, boundaries between values", 3),
    ):
        check_percents(read_percents(text, f" {label}"), number)
