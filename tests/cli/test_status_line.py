import io

from drake_srg.cli.status_line import StatusLine


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_terminal_updates_the_line_in_place():
    stream = Terminal()
    line = StatusLine(stream)
    line.show("1 s")
    line.show("2 s")
    line.close()
    assert stream.getvalue() == "\r1 s\x1b[K\r2 s\x1b[K\n"


def test_anything_else_gets_the_line_once():
    stream = io.StringIO()
    line = StatusLine(stream)
    line.show("1 s")
    line.show("2 s")
    line.close()
    assert stream.getvalue() == "1 s\n"


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
