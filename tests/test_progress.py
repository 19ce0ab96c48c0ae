"""What takes long shows how far it is, where somebody looks."""

import io
import sys

import jax.numpy as jnp
import pytest

import jaxrock as jr
from jaxrock.host import show_progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def look(monkeypatch, stderr):
    """Let bars be shown at once."""
    progress = sys.modules["jaxrock.host.progress"]
    make = progress.tqdm
    options = {"mininterval": 0, "delay": 0}
    monkeypatch.setattr(progress, "tqdm", lambda items, **o: make(items, **o | options))
    monkeypatch.setattr("sys.stderr", stderr)
    return stderr


def test_items_and_motions_are_counted(monkeypatch):
    terminal = look(monkeypatch, Terminal())
    assert list(show_progress(range(4), "steps")) == [0, 1, 2, 3]
    jr.respond_batch(jr.Block(jnp.linspace(0.1, 0.2, 8192), 5.0), 0.9, jr.Sine(2.5, 0.5))
    assert all(text in terminal.getvalue() for text in ("steps:  75%", "8192/8192"))


@pytest.mark.parametrize("stderr", [io.StringIO(), None])
def test_nothing_is_shown_elsewhere(monkeypatch, stderr):
    look(monkeypatch, stderr)
    assert list(show_progress(range(4), "steps")) == [0, 1, 2, 3]
    assert stderr is None or stderr.getvalue() == ""
