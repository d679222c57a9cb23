import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from navcore.errors import DataError
from navcore.readers.table import count_columns, read_names, read_table

GOOD = ["1403636579758555392,1.5,-2", "1403636579763555584,2.5e-3,4"]


def table(folder, lines):
    path = folder / "data.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_every_digit_of_a_stamp_is_kept(tmp_path):
    t_ns, values = read_table(table(tmp_path, GOOD), 2, "t_ns, a, b")
    assert t_ns.tolist() == [1403636579758555392, 1403636579763555584]
    np.testing.assert_array_equal(values, [[1.5, -2.0], [2.5e-3, 4.0]])


@given(st.lists(st.tuples(st.integers(1, 10**12), st.floats(-1e6, 1e6)), min_size=1, max_size=30))
def test_what_is_written_is_read(tmp_path_factory, rows):
    stamps = np.cumsum([step for step, _ in rows]) + 10**18
    values = [value for _, value in rows]
    lines = [f"{t},{x!r}" for t, x in zip(stamps.tolist(), values, strict=True)]
    t_ns, read = read_table(table(tmp_path_factory.mktemp("t"), lines), 1, "t_ns, a")
    np.testing.assert_array_equal(t_ns, stamps)
    np.testing.assert_array_equal(read[:, 0], values)


@pytest.mark.parametrize("header", ["#timestamp [ns],a,b", "t_ns,a,b", "\ufefft_ns,a,b", ""])
def test_headers_with_and_without_a_hash(tmp_path, header):
    path = tmp_path / "data.csv"
    path.write_text("\n".join([header, *GOOD, ""]), encoding="utf-8")
    assert len(read_table(path, 2, "t_ns, a, b")[0]) == 2
    assert count_columns(path, "t_ns, a, b") == 2


def test_a_byte_order_mark_is_no_part_of_the_first_stamp(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("\n".join(GOOD), encoding="utf-8-sig")
    assert read_table(path, 2, "t_ns, a, b")[0][0] == 1403636579758555392


def test_line_ends_of_windows(tmp_path):
    path = tmp_path / "data.csv"
    path.write_bytes(("#t,a,b\r\n" + "\r\n".join(GOOD) + "\r\n").encode())
    assert read_table(path, 2, "t_ns, a, b")[1][1, 1] == 4.0


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("1403636579768555776,1", "2 fields, expected 3: t_ns, a, b"),
        ("1403636579768555776,1,2,3", "4 fields, expected 3"),
        ("1403636579768555776,1,nan", "field 3 is 'nan', expected a finite number"),
        ("1403636579768555776,inf,1", "field 2 is 'inf'"),
        ("1403636579768555776,1,", "field 3 is ''"),
        ("1403636579768555776,one,2", "field 2 is 'one'"),
        ("1.403636579768555776e18,1,2", "not a whole number of nanoseconds"),
        ("nan,1,2", "not a whole number of nanoseconds"),
        ("99999999999999999999,1,2", "not a whole number of nanoseconds"),
        ("1403636579763555584,1,2", "stamp 1403636579763555584 ns is repeated"),
        ("1403636579758555393,1,2", "out of order, it comes after 1403636579763555584 ns"),
        ("\x00\x80\xff", "fields, expected 3"),
    ],
)
def test_a_wrong_row_is_named_by_file_and_line(tmp_path, line, says):
    path = table(tmp_path, ["#t,a,b", *GOOD, "", line, "1503636579768555776,5,6"])
    with pytest.raises(DataError) as error:
        read_table(path, 2, "t_ns, a, b")
    assert str(error.value).startswith(f"{path}:5: ")
    assert says in str(error.value)


def test_a_wrong_first_row_is_not_taken_for_a_header(tmp_path):
    with pytest.raises(DataError, match=r"data\.csv:1: "):
        read_table(table(tmp_path, ["14036365797x,1,2", *GOOD]), 2, "t_ns, a, b")


@pytest.mark.parametrize("lines", [[], ["#t,a,b"], ["t,a,b"]])
def test_a_table_without_rows(tmp_path, lines):
    path = table(tmp_path, lines)
    for read in (lambda: read_table(path, 2, "t_ns, a, b"), lambda: count_columns(path, "t_ns, a, b")):
        with pytest.raises(DataError, match="no rows; expected t_ns, a, b"):
            read()


def test_a_missing_table(tmp_path):
    with pytest.raises(DataError, match=r"gone\.csv: no such file; expected rows of t_ns, a"):
        read_table(tmp_path / "gone.csv", 1, "t_ns, a")


def test_nan_only_where_it_is_allowed(tmp_path):
    path = table(tmp_path, ["1,nan,2", "2,1,nan"])
    assert np.isnan(read_table(path, 2, "t_ns, a, b", nan_columns=(0, 1))[1]).sum() == 2
    with pytest.raises(DataError, match=r"data\.csv:1: field 2 is 'inf'"):
        read_table(table(tmp_path, ["1,inf,2"]), 2, "t_ns, a, b", nan_columns=(0, 1))
    path = table(tmp_path, ["1,nan,2", "2,1,nan"])
    with pytest.raises(DataError, match=r"data\.csv:2: field 3"):
        read_table(path, 2, "t_ns, a, b", nan_columns=(0,))


def test_repeats_only_where_they_are_allowed(tmp_path):
    path = table(tmp_path, ["1,1", "1,2", "2,3"])
    assert read_table(path, 1, "t_ns, a", repeats=True)[0].tolist() == [1, 1, 2]
    with pytest.raises(DataError, match=r"data\.csv:2: .*repeated"):
        read_table(path, 1, "t_ns, a")
    with pytest.raises(DataError, match=r"data\.csv:3: .*out of order"):
        read_table(table(tmp_path, ["1,1", "1,2", "0,3"]), 1, "t_ns, a", repeats=True)


@pytest.mark.parametrize("line", ["3", "3,", "x,3.png", "1,1.png", "0,0.png", "3,a.png,b"])
def test_a_wrong_row_of_names(tmp_path, line):
    path = table(tmp_path, ["#t,name", "1,1.png", line])
    with pytest.raises(DataError, match=r"data\.csv:3: "):
        read_names(path, "t_ns, file name")


@pytest.mark.bench
def test_ten_minutes_of_imu_in_under_a_second(tmp_path):
    values = np.random.default_rng(0).normal(size=(120_000, 6))
    rows = (",".join(f"{x:.10f}" for x in row) for row in values.tolist())
    path = table(tmp_path, [f"{10**18 + 5_000_000 * k},{row}" for k, row in enumerate(rows)])
    start = time.process_time()
    t_ns, _ = read_table(path, 6, "t_ns, gyro, accelerometer")
    seconds = time.process_time() - start
    print(f"\n120000 rows of 7 numbers: {seconds:.3f} s")
    assert len(t_ns) == 120_000
    assert seconds < 1.0
