"""What takes long shows that it goes on: on a terminal, and in lines from commands."""

import io
import time

import jax
import jax.monitoring
import pytest

from jaxrock.host import progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(progress, "_SILENT", 0.05)


@pytest.mark.parametrize(("terminal", "shown"), [(Terminal, True), (io.StringIO, False)])
def test_clock(quick, monkeypatch, terminal, shown):
    monkeypatch.setattr("sys.stderr", terminal())
    with progress.show_clock("outer"), progress.show_clock("inner"):
        time.sleep(0.3)
    text = progress.sys.stderr.getvalue()
    assert ("outer: 00:0" in text) == shown
    assert "inner" not in text


@pytest.mark.parametrize(("terminal", "shown"), [(Terminal, True), (io.StringIO, False)])
def test_loop(quick, monkeypatch, terminal, shown):
    monkeypatch.setattr("sys.stderr", terminal())
    for _ in progress.show_progress(range(6), "steps"):
        time.sleep(0.05)
    assert ("steps:" in progress.sys.stderr.getvalue()) == shown


def test_what_is_over_soon_shows_nothing_and_errors_pass(monkeypatch):
    monkeypatch.setattr("sys.stderr", Terminal())
    with pytest.raises(ValueError, match="inside"), progress.show_clock("label"):
        raise ValueError("inside")
    assert progress.sys.stderr.getvalue() == ""
    assert progress._showing.acquire(blocking=False)
    progress._showing.release()


def test_a_part_of_something_larger_shows_nothing(quick, monkeypatch):
    monkeypatch.setattr("sys.stderr", Terminal())
    with progress.hide_progress():
        for _ in progress.show_progress(range(3), "steps"):
            time.sleep(0.05)
        with progress.show_clock("clock"):
            time.sleep(0.15)
    assert progress.sys.stderr.getvalue() == ""


def test_lines_where_there_is_no_terminal(monkeypatch):
    monkeypatch.setattr(progress, "_EVERY", 0.1)
    monkeypatch.setattr("sys.stderr", io.StringIO())
    with progress.speak_of_waits(), progress.show_clock("jaxrock fragility"):
        for _ in progress.show_progress(["a", "b", "c"], "records"):
            time.sleep(0.15)
        progress.announce("timing takes some 6 s")
    lines = progress.sys.stderr.getvalue().splitlines()
    assert lines[0] == "jaxrock fragility: 0 s, records: 0 of 3"
    assert "jaxrock fragility: 0 s, records: 2 of 3" in lines
    assert lines[-1] == "jaxrock: timing takes some 6 s"
    # A library says nothing of its own accord.
    monkeypatch.setattr("sys.stderr", io.StringIO())
    with progress.show_clock("clock"):
        progress.announce("words")
        time.sleep(0.2)
    assert progress.sys.stderr.getvalue() == ""


def test_what_is_compiled_is_said():
    """JAX's own events tell when a program is compiled, if programs are kept."""
    seen = []
    with progress.speak_of_waits():
        pass
    assert progress._doing.listening
    jax.monitoring.register_event_listener(
        lambda event, **_: seen.append(str(progress._doing))
    )
    compiled = progress._doing.compiled
    jax.jit(lambda x: 3 * x + 0.123456789)(1.0)
    assert progress._doing.compiled > compiled
    assert not progress._doing.compiling
    assert any(words.startswith("compiling program ") for words in seen)


def test_a_process_without_stderr_prints_nothing(quick, monkeypatch, capsys):
    monkeypatch.setattr(progress, "_EVERY", 0.05)
    monkeypatch.setattr("sys.stderr", None)
    with progress.speak_of_waits(), progress.show_clock("clock"):
        for _ in progress.show_progress(range(3), "steps"):
            time.sleep(0.1)
        progress.announce("words")
    assert capsys.readouterr().out == ""
