import pytest

from navcore.command_line import command_line
from navcore.errors import DataError


class TooLate(Exception):
    pass


@pytest.mark.parametrize(
    ("error", "resumes", "code", "said"),
    [
        (DataError("a [b] c.csv:3: no number"), False, 1, "error: a [b] c.csv:3: no number\n"),
        (TooLate("closed"), False, 1, "error: closed\n"),
        (KeyboardInterrupt(), False, 130, "interrupted\n"),
        (KeyboardInterrupt(), True, 130, "interrupted; the same command goes on where it stopped\n"),
    ],
)
def test_what_is_expected_ends_in_one_line(error, resumes, code, said, capsys):
    with pytest.raises(SystemExit) as end, command_line(TooLate, resumes=resumes):
        raise error
    assert end.value.code == code
    assert capsys.readouterr() == ("", said)


def test_what_is_not_expected_goes_through():
    with pytest.raises(ZeroDivisionError), command_line(TooLate):
        raise ZeroDivisionError
