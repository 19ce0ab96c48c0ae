"""What takes long shows how far it is: a bar on a terminal, elsewhere messages."""

import contextlib
import io
import logging
import re
import time

import jax.numpy as jnp
import pytest

import jaxrock as jr
from jaxrock.host import count_work, hide_progress, name_work, progress, show_progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def quick(monkeypatch, caplog):
    """Seconds are as hours; messages are for who asks for them."""
    monkeypatch.setattr(progress, "_SHORT", 0.0)
    monkeypatch.setattr(progress, "_MOMENT", 0.0)
    monkeypatch.setattr(progress, "_LONG", 0.02)
    monkeypatch.setattr(progress, "_BETWEEN", 0.0)
    monkeypatch.setattr("sys.stderr", io.StringIO())
    with caplog.at_level(logging.INFO, "jaxrock"):
        yield caplog


def loop():
    for _ in show_progress(range(4), "steps"):
        time.sleep(0.01)


def read_percents(text, label):
    return [int(percent) for percent in re.findall(rf"{label}: +(\d+) ?%", text)]


def test_a_bar_on_a_terminal(quick, monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    loop()
    assert read_percents(terminal.getvalue(), "steps") == [0, 25, 50, 75, 100]
    assert quick.messages == []


@pytest.mark.parametrize("stderr", [io.StringIO(), None])
def test_messages_elsewhere(quick, monkeypatch, stderr):
    monkeypatch.setattr("sys.stderr", stderr)
    loop()
    assert read_percents(quick.text, "steps") == [25, 50, 75]
    assert "steps: done" in quick.messages[-1]
    assert stderr is None or stderr.getvalue() == ""


def test_what_is_over_soon_says_nothing(quick, monkeypatch):
    monkeypatch.undo()
    loop()
    assert quick.messages == []


def test_what_is_hidden_or_fails_says_nothing(quick):
    with hide_progress():
        loop()
    with contextlib.suppress(ValueError), count_work("motions", 2):
        time.sleep(0.03)
        raise ValueError
    assert quick.messages == []


def test_parts_advance_the_whole_which_may_turn_out_longer(quick):
    with name_work("widths"), count_work("rounds", 10) as work:
        for remaining in (10, 10, 5):
            work.expect(remaining)
            with count_work("motions", 5) as part:
                # What a part expects says nothing of the whole.
                part.expect(1000)
                part.advance(5)
    assert read_percents(quick.text, "widths, rounds") == [50, 75]


def test_motions_are_counted(quick):
    widths = jnp.linspace(0.1, 0.2, 8192)
    jr.respond_batch(jr.Block(widths, 5.0), 0.9, jr.Sine(2.5, 0.5))
    percents = read_percents(quick.text, "motions")
    assert len(percents) >= 3
    assert percents == sorted(percents)
