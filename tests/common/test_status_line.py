import io

import pytest

from drake_srg.common.status_line import StatusLine


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Clock:
    """A clock that advances by a step at each reading."""

    def __init__(self, step):
        self.step, self.now = step, 0.0

    def __call__(self):
        self.now += self.step
        return self.now


@pytest.fixture(autouse=True)
def able_terminal(monkeypatch):
    """Make the tests independent of the terminal in which they run."""
    monkeypatch.setenv("TERM", "xterm")


def test_a_terminal_updates_the_line_in_place():
    stream = Terminal()
    with StatusLine(stream, clock=Clock(1.0)) as line:
        line.show("1 s")
        line.show("2 s")
    assert stream.getvalue() == "\r1 s\x1b[K\r2 s\x1b[K\n"


def test_a_terminal_is_not_flooded():
    stream = Terminal()
    line = StatusLine(stream, clock=Clock(0.04))
    for number in range(6):
        line.show(str(number))
    assert stream.getvalue() == "\r0\x1b[K\r3\x1b[K"


@pytest.mark.parametrize(
    ("at_once", "shown"), [(False, "3\n6\n"), (True, "0\n3\n6\n")], ids=str
)
def test_anything_else_gets_a_line_a_minute(at_once, shown):
    stream = io.StringIO()
    with StatusLine(stream, at_once=at_once, clock=Clock(20.0)) as line:
        for number in range(7):
            line.show(str(number) if at_once else str(number + 1))
    assert stream.getvalue() == shown


def test_parts_are_counted_with_the_time_left():
    stream = Terminal()
    line = StatusLine(stream, clock=Clock(10.0))
    line.count(3, 8, "trials", begun=1)
    assert "3/8 trials [0:10 elapsed, 0:25 left]" in stream.getvalue()
    line.count(8, 8, "trials")
    assert "8/8 trials [0:30 elapsed]" in stream.getvalue()


def test_nothing_is_shown_where_nothing_is_wanted(capsys):
    stream = Terminal()
    line = StatusLine(stream, shown=False)
    line.show("1 s")
    line.interrupt("drake-srg: warning: slow")
    line.close()
    assert stream.getvalue() == ""
    assert capsys.readouterr().err == "drake-srg: warning: slow\n"


def test_a_line_longer_than_the_terminal_is_cut(monkeypatch):
    monkeypatch.setenv("COLUMNS", "10")
    stream = Terminal()
    StatusLine(stream).show("0123456789abc")
    assert stream.getvalue() == "\r012345678\x1b[K"


def test_a_warning_gets_a_line_of_its_own(capsys):
    stream = Terminal()
    line = StatusLine(stream)
    line.show("1 s")
    line.interrupt("drake-srg: warning: slow")
    assert stream.getvalue() == "\r1 s\x1b[K\r\x1b[K1 s"
    assert capsys.readouterr().err == "drake-srg: warning: slow\n"
