"""What takes long shows that it goes on, on a terminal only."""

import io
import time

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
