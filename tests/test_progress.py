"""What takes long shows that it goes on: a bar on a terminal, elsewhere a message at its end."""

import io
import logging
import time

import pytest

from jaxrock.host import announce, hide_progress, progress, show_progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(progress, "_SHORT", 0.02)
    monkeypatch.setattr(progress, "_LONG", 0.02)


def loop():
    """Go through a loop that takes a while; what it went through."""
    items = []
    for item in show_progress(range(4), "steps"):
        time.sleep(0.06)
        items.append(item)
    return items


def test_a_bar_on_a_terminal(quick, monkeypatch, caplog):
    monkeypatch.setattr("sys.stderr", Terminal())
    with caplog.at_level(logging.INFO, "jaxrock"):
        assert loop() == [0, 1, 2, 3]
    assert "steps:" in progress.sys.stderr.getvalue()
    assert caplog.messages == []


@pytest.mark.parametrize("stderr", [io.StringIO(), None])
def test_a_message_elsewhere(quick, monkeypatch, caplog, stderr):
    """Which nobody sees who has not asked for messages."""
    monkeypatch.setattr("sys.stderr", stderr)
    with caplog.at_level(logging.INFO, "jaxrock"):
        assert loop() == [0, 1, 2, 3]
        announce("timing takes some 6 s")
    assert caplog.messages == ["steps: done in 0 s", "timing takes some 6 s"]
    caplog.clear()
    loop()
    assert caplog.messages == []
    assert stderr is None or stderr.getvalue() == ""


def test_what_is_over_soon_says_nothing(monkeypatch, caplog):
    monkeypatch.setattr("sys.stderr", io.StringIO())
    with caplog.at_level(logging.INFO, "jaxrock"):
        loop()
    assert caplog.messages == []


def test_a_part_of_something_larger_says_nothing(quick, monkeypatch, caplog):
    monkeypatch.setattr("sys.stderr", Terminal())
    with hide_progress(), caplog.at_level(logging.INFO, "jaxrock"):
        loop()
    assert progress.sys.stderr.getvalue() == ""
    assert caplog.messages == []
