"""Reading recordings: what is found out by itself, and what every mistake is called."""

import sys

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.cli._columns import asked_columns
from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.cli._sampling import find_column, other_unit, sample_evenly
from narx_sklearn.cli._tables import read_table
from narx_sklearn.exceptions import ExcitationWarning

U, Y = [0.5, -1.25, 2.0, 3.5], [1.0, 2.0, 3.25, 4.0]
TIMES = [0.0, 0.5, 1.0, 1.5]


def written(tmp_path, text, *, encoding="utf-8"):
    path = tmp_path / "record.csv"
    path.write_bytes(text.encode(encoding))
    return str(path)


def record(separator, decimal, header="time [s]{0}drive [V]{0}position [m]\n", times=TIMES):
    rows = (
        separator.join(f"{v!r}".replace(".", decimal) for v in row) for row in zip(times, U, Y, strict=True)
    )
    return header.format(separator) + "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    ("separator", "decimal"),
    [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("|", ","), ("  ", ".")],
)
@pytest.mark.parametrize("header", [True, False], ids=["header", "no header"])
def test_separator_and_decimal_mark_are_found_out(tmp_path, separator, decimal, header):
    names = {"header": "time{0}drive{0}position\n"} if header else {"header": ""}
    frame = read_table(written(tmp_path, record(separator, decimal, **names))).frame
    np.testing.assert_array_equal(frame.to_numpy(), np.column_stack([TIMES, U, Y]))
    assert list(frame) == (["time", "drive", "position"] if header else ["column 1", "column 2", "column 3"])


@given(
    st.lists(
        st.tuples(*[st.floats(-1e6, 1e6, allow_nan=False).map(lambda v: round(v, 6))] * 2),
        min_size=3,
        max_size=12,
    ),
    st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", ",")]),
)
def test_what_is_written_is_read_whatever_the_layout(tmp_path_factory, rows, layout):
    separator, decimal = layout
    text = f"u{separator}y\n" + "\n".join(
        separator.join(f"{v:.6f}".replace(".", decimal) for v in row) for row in rows
    )
    frame = read_table(written(tmp_path_factory.mktemp("t"), text)).frame
    np.testing.assert_allclose(frame.to_numpy(), rows, rtol=1e-15)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_byte_order_marks_and_old_encodings_are_read(tmp_path, encoding):
    text = record(";", ",", header="time [s]{0}Kraft [N]{0}Weg [µm]\n")
    assert list(read_table(written(tmp_path, text, encoding=encoding)).frame)[2] == "Weg [µm]"


def test_units_in_a_line_of_their_own_join_the_names(tmp_path):
    text = record(",", ".", header="time,drive,position\ns,V,m\n")
    assert list(read_table(written(tmp_path, text)).frame) == ["time [s]", "drive [V]", "position [m]"]


def test_lines_above_the_header_and_comments_are_passed_over(tmp_path):
    text = "Bench 7 exported by the logger\n# a comment, with commas\n" + record(",", ".")
    assert read_table(written(tmp_path, text)).frame.shape == (4, 3)


@pytest.mark.parametrize("mark", ["", "NaN", "n/a", "-", "null"])
def test_missing_values_are_nan(tmp_path, mark):
    frame = read_table(written(tmp_path, f"u,y\n1,2\n{mark},3\n4,5\n6,7\n")).frame
    assert np.isnan(frame["u"][1])
    assert frame.isna().to_numpy().sum() == 1


@pytest.mark.parametrize("ending", [";", ""], ids=["header too", "values only"])
def test_a_separator_at_the_end_of_each_line_makes_no_column(tmp_path, ending):
    rows = [f"{t};{u};{y};" for t, u, y in zip(TIMES, U, Y, strict=True)]
    text = "\n".join(["time [s];drive [V];position [m]" + ending, *rows])
    table = read_table(written(tmp_path, text))
    assert "Column 4 has no name and no value; left out." in table.notes
    sampled = sample_evenly(table)
    assert list(sampled.frame) == ["drive [V]", "position [m]"]
    with pytest.raises(UsageError, match="that column has no name and no value"):
        asked_columns(table, list(sampled.frame), "4", "--u")


def test_a_nameless_empty_column_in_the_middle_counts_where_columns_are_numbered(tmp_path):
    table = read_table(written(tmp_path, "t,,u,y\n0,,1,2\n1,,2,3\n2,,4,5\n"))
    sampled = sample_evenly(table)
    assert list(sampled.frame) == ["u", "y"]
    assert asked_columns(table, list(sampled.frame), "3", "--u") == ["u"]


def test_a_column_with_a_name_or_a_value_stays(tmp_path):
    table = read_table(written(tmp_path, "t,u,,z\n0,1,,\n1,2,7,\n2,4,,\n"))
    assert list(sample_evenly(table).frame) == ["u", "column 3", "z"]


def test_iso_time_stamps_give_the_period(tmp_path):
    rows = "\n".join(f"2026-03-01T12:00:0{k // 2}.{5 * (k % 2)}00Z;{k},5" for k in range(8))
    sampled = sample_evenly(read_table(written(tmp_path, "when;u\n" + rows)))
    assert sampled.dt == pytest.approx(0.5, rel=1e-12)
    assert list(sampled.frame) == ["u"]


@pytest.mark.parametrize(
    "stamps",
    [
        ["31.01.2026 23:59:50", "31.01.2026 23:59:55", "01.02.2026 00:00:00", "01.02.2026 00:00:05"],
        [
            "01/31/2026 11:59:50 PM",
            "01/31/2026 11:59:55 PM",
            "02/01/2026 12:00:00 AM",
            "02/01/2026 12:00:05 AM",
        ],
        ["31/01/2026 23:59:50", "31/01/2026 23:59:55", "01/02/2026 00:00:00", "01/02/2026 00:00:05"],
        ["2026/01/31 23:59:50", "2026/01/31 23:59:55", "2026/02/01 00:00:00", "2026/02/01 00:00:05"],
        ["23:59:50", "23:59:55", "0:00:00", "0:00:05"],
        ["23:59:50,000", "23:59:55,000", "0:00:00,000", "0:00:05,000"],
        ["59:50.000", "59:55.000", "00:00.000", "00:05.000"],
        ["59:50,0", "59:55,0", "1:00:00,0", "1:00:05,0"],
        ["59:50.0", "59:55.0", "60:00.0", "60:05.0"],
    ],
    ids=["points", "month first", "day first", "year first", "clock", "parts", "wraps", "hours", "minutes"],
)
def test_stamps_of_many_lands_give_the_period_over_midnight(tmp_path, stamps):
    rows = "\n".join(f"{stamp};{k},5" for k, stamp in enumerate(stamps))
    sampled = sample_evenly(read_table(written(tmp_path, "when;u\n" + rows)))
    assert sampled.dt == pytest.approx(5.0)
    assert len(set(sampled.sessions)) == 1


@pytest.mark.parametrize("mark", [".", ","])
def test_minutes_and_seconds_with_a_fraction_give_the_period(tmp_path, mark):
    rows = "\n".join(f"00:00{mark}{10 * k:03d};{k}" for k in range(5))
    sampled = sample_evenly(read_table(written(tmp_path, "time [s];u\n" + rows)))
    assert sampled.dt == pytest.approx(0.01)
    assert any(f"'00:00{mark}000' in column 'time [s]' are read as minutes" in n for n in sampled.notes)


def test_two_numbers_and_a_colon_are_told_to_be_hours_and_minutes(tmp_path):
    sampled = sample_evenly(read_table(written(tmp_path, "time,u\n00:00,1\n00:01,2\n00:02,4\n")))
    assert sampled.dt == pytest.approx(60.0)
    assert "Times such as '00:00' in column 'time' are read as hours and minutes." in sampled.notes


@pytest.mark.parametrize("asked", [None, "time"])
def test_words_are_no_time(tmp_path, asked):
    table = read_table(written(tmp_path, "time [s],u\n0h00m00,1\n0h00m01,2\n0h00m02,4\n"))
    with pytest.raises(DataError, match=r"'time \[s\]' of .* words such as '0h00m00'.*01:02\.5.*--dt"):
        sample_evenly(table, time=asked)
    assert sample_evenly(table, dt=0.1).dt == 0.1


def test_numbers_tell_the_time_before_words_do(tmp_path):
    table = read_table(written(tmp_path, "date,t [s],u\nmonday,0,1\nmonday,0.5,2\nmonday,1,4\n"))
    assert sample_evenly(table).dt == pytest.approx(0.5)


def test_of_a_date_and_a_clock_in_two_columns_the_clock_gives_the_period(tmp_path):
    rows = "\n".join(f"01.03.2026;10:00:0{k},5;{k}" for k in range(5))
    sampled = sample_evenly(read_table(written(tmp_path, "date;clock;u\n" + rows)))
    assert sampled.dt == pytest.approx(1.0)


@pytest.mark.parametrize(("unit", "seconds"), [("s", 0.5), ("ms", 0.5e-3), ("min", 30.0), ("d", 43200.0)])
def test_time_counts_in_the_unit_of_its_header(tmp_path, unit, seconds):
    text = record(",", ".", header=f"time [{unit}]{{0}}u{{0}}y\n")
    assert sample_evenly(read_table(written(tmp_path, text))).dt == pytest.approx(seconds, rel=1e-12)


def test_a_gap_in_time_begins_another_session(tmp_path):
    text = record(",", ".", times=[0.0, 0.5, 5.0, 5.5])
    sampled = sample_evenly(read_table(written(tmp_path, text)))
    assert sampled.dt == pytest.approx(0.5)
    assert sampled.sessions.tolist() == [0, 0, 1, 1]
    assert any("1 gap in time" in note for note in sampled.notes)


def test_a_period_that_agrees_with_the_time_column_hides_no_gap(tmp_path):
    table = read_table(written(tmp_path, record(",", ".", times=[0.0, 0.5, 5.0, 5.5])))
    sampled = sample_evenly(table, dt=0.502)
    assert sampled.dt == pytest.approx(0.5)
    assert sampled.sessions.tolist() == [0, 0, 1, 1]


def test_a_period_that_differs_from_the_time_column_is_refused_unless_the_column_is_set_aside(tmp_path):
    table = read_table(written(tmp_path, record(",", ".")))
    told = (
        r"--dt .* of 0.02 s, column 'time \[s\]' of .* 0.5 s. Leave out --dt .*--resample 0.02 .*--time none"
    )
    with pytest.raises(UsageError, match=told):
        sample_evenly(table, dt=0.02)
    with pytest.raises(UsageError, match=r"is column 'time \[s\]' in ms\?"):
        sample_evenly(table, dt=0.5e-3)
    with pytest.raises(UsageError, match=r"of 0.02 s, --resample a grid of 0.25 s"):
        sample_evenly(table, dt=0.02, resample=0.25)
    sampled = sample_evenly(table, dt=0.02, time="none")
    assert sampled.dt == 0.02
    assert list(sampled.frame) == ["drive [V]", "position [m]"]
    assert "Column 'time [s]' is set aside; samples are counted, and no gap is seen." in sampled.notes
    named = read_table(written(tmp_path, "none,u\n0,1\n1,2\n"))
    assert list(sample_evenly(named, time="none").frame) == ["u"]


def test_rows_that_are_there_twice_are_dropped_and_told(tmp_path):
    table = read_table(written(tmp_path, "t [s],u,y\n0,1,2\n1,2,\n1,2,\n2,3,4\n2,3,4\n3,3,4\n"))
    sampled = sample_evenly(table)
    assert sampled.frame["u"].tolist() == [1, 2, 3, 3]
    assert sampled.dt == 1.0
    assert "2 rows repeat the rows before, their time and all their values; dropped." in sampled.notes


def test_rows_of_one_time_that_differ_are_refused_with_a_way_that_goes(tmp_path):
    table = read_table(written(tmp_path, "t [s],u,y\n0,1,2\n0,1,2\n1,3,4\n1,4,4\n"))  # stamps are coarse
    told = r"Time stands still .* after row 1 .*that differ cannot both be right.*--time none"
    with pytest.raises(DataError, match=told):
        sample_evenly(table)
    assert sample_evenly(table, time="none", dt=0.5).dt == 0.5


def test_uneven_sampling_is_refused_with_a_way_out_and_resampled_on_demand(tmp_path):
    table = read_table(written(tmp_path, record(",", ".", times=[0.0, 0.5, 1.2, 1.5])))
    with pytest.raises(DataError, match=r"uneven: steps .* between 0\.3 s and 0\.7 s.*--resample"):
        sample_evenly(table)
    sampled = sample_evenly(table, resample=0.25)
    np.testing.assert_allclose(sampled.frame["drive [V]"][:3], [0.5, -0.375, -1.25])  # half way, by hand
    assert sampled.dt == 0.25
    assert len(sampled.frame) == 7


def test_a_grid_much_finer_than_the_samples_is_warned_of_and_a_far_finer_one_refused(tmp_path):
    table = read_table(written(tmp_path, record(",", ".", header="t{0}u{0}y\n", times=[0, 500, 1000, 1500])))
    with pytest.warns(ExcitationWarning, match=r"5 s makes 300 samples of the 4 .* Pass --resample 500 or"):
        assert len(sample_evenly(table, resample=5.0).frame) == 301
    told = r"makes 3000 samples of the 4 in .*, which are 500 s apart; .* is column 't' in ms\? .*Else pass"
    with pytest.raises(DataError, match=told):
        sample_evenly(table, resample=0.5)


@pytest.mark.parametrize(
    ("recorded", "column", "told"),
    [
        (10.0, "t", "1000 times as much: is column 't' in ms? Then label it 't [ms]'. "),
        (10.0, "t [s]", "1000 times as much: is column 't [s]' in ms? Then label it 't [ms]'. "),
        (1e4, "t", "1e+06 times as much: is column 't' in us?"),
        (1e-5, "t [ms]", "a 1000th: is column 't [ms]' in s?"),
        (0.01 / 60, "t", "a 60th: is column 't' in min?"),
        (0.01 / 3600, "t", "a 3600th: is column 't' in h?"),
        (0.01 / 86400, "t", "a 86400th: is column 't' in d?"),
        (10.0, None, "1000 times as much: is --dt in ms? It is wanted in s: pass --dt 0.01. "),
    ],
)
def test_periods_that_differ_by_a_unit_are_asked_about(recorded, column, told):
    assert told in other_unit(recorded, 0.01, column)


@pytest.mark.parametrize("recorded", [0.01, 0.02, 0.1, 7.0])
def test_periods_that_differ_by_no_unit_are_not(recorded):
    assert other_unit(recorded, 0.01, "t") == ""


def test_time_may_begin_anew_in_every_session(tmp_path):
    table = read_table(written(tmp_path, "t,u,run\n0,1,A\n1,2,A\n2,3,A\n0,4,B\n1,5,B\n"))
    with pytest.raises(DataError, match=r"runs backwards .* after row 3 .*--session"):
        sample_evenly(table)
    sampled = sample_evenly(table, session="run")
    assert sampled.dt == 1.0
    assert sampled.sessions.tolist() == [0, 0, 0, 1, 1]
    assert list(sampled.frame) == ["u"]
    resampled = sample_evenly(table, session="run", resample=0.5)
    assert resampled.sessions.tolist() == [0] * 5 + [1] * 3
    assert resampled.frame["u"].tolist() == [1, 1.5, 2, 2.5, 3, 4, 4.5, 5]


def test_a_sample_that_belongs_to_no_session_is_refused(tmp_path):
    table = read_table(written(tmp_path, "u,run\n1,1\n2,\n3,2\n"))
    with pytest.raises(DataError, match=r"'run' of .* names no session in row 2"):
        sample_evenly(table, session="run")


def test_a_column_of_words_is_passed_over_and_told(tmp_path):
    table = read_table(written(tmp_path, "u,state,y\n1,OK,2\n3,late,4\n5,,6\n"))
    assert table.words == {"state": "OK"}
    assert any("'state' holds words such as 'OK'" in note for note in table.notes)
    assert list(sample_evenly(table).frame) == ["u", "y"]
    with pytest.raises(UsageError, match="--u state: column 'state' holds words such as 'OK', not numbers"):
        asked_columns(table, ["u", "y"], "state", "--u")


def test_a_hash_begins_a_comment_only_at_the_beginning_of_a_line(tmp_path):
    text = "u,y,z\n# 1,2,3\n1,#N/A,3\n4,5,6\n#N/A,8,9\n"
    frame = read_table(written(tmp_path, text)).frame
    np.testing.assert_array_equal(frame, [[1, np.nan, 3], [4, 5, 6], [np.nan, 8, 9]])


def test_a_column_is_numbered_as_it_stands_in_the_file_and_may_have_a_comma_in_its_name(tmp_path):
    table = read_table(written(tmp_path, 'time,"drive, left",y\n0,1,2\n1,3,4\n'))
    signals = list(sample_evenly(table).frame)
    assert asked_columns(table, signals, "2", "--u") == ["drive, left"]
    assert asked_columns(table, signals, "drive, left", "--u") == ["drive, left"]
    assert asked_columns(table, signals, "3, 2", "--u") == ["y", "drive, left"]
    with pytest.raises(UsageError, match="column 'time' is the time"):
        asked_columns(table, signals, "time", "--u")


def test_resampling_fills_no_missing_value(tmp_path):
    table = read_table(written(tmp_path, "t,u\n0,1\n1,\n2,3\n3,4\n"))
    resampled = sample_evenly(table, resample=0.5).frame["u"].to_numpy()
    assert np.isnan(resampled[1:4]).all()
    assert np.isfinite(resampled[[0, 4, 5, 6]]).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("u,y\n", "a header, but no line of values"),
        ("hello\nworld\n", "does not look like a table of numbers"),
        ("u,y\n1,2\n3,x4\n5,6\n7,8\n", r"line 3, column 'y': 'x4' is not a number"),
        ("u,y\n1,2\n3,4,5\n6,7\n8,9\n", "line 3 has 3 values, the lines before 2"),
        ("u,u\n1,2\n3,4\n", "two columns named 'u'"),
        ('u,y\n"1,2\n', "quotation mark that is opened and never closed"),
    ],
)
def test_a_table_that_cannot_be_read_says_where(tmp_path, text, message):
    with pytest.raises(DataError, match=message):
        read_table(written(tmp_path, text))


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.0, 0.5, 0.4, 1.0], "runs backwards .* after row 2"),
        ([0.0, 0.5, 0.5, 1.0], "stands still .* after row 2"),
    ],
)
def test_time_that_does_not_run_is_refused(tmp_path, times, message):
    with pytest.raises(DataError, match=message):
        sample_evenly(read_table(written(tmp_path, record(",", ".", times=times))))


def test_a_time_unit_that_is_not_known_is_refused(tmp_path):
    text = record(",", ".", header="time [fortnight]{0}u{0}y\n")
    with pytest.raises(DataError, match="'fortnight', which is not known"):
        sample_evenly(read_table(written(tmp_path, text)))


# -- parquet -----------------------------------------------------------------------------------------------


def parquet(tmp_path, frame):
    pytest.importorskip("pyarrow", reason="parquet needs pyarrow")
    path = tmp_path / "record.parquet"
    frame.to_parquet(path)
    return read_table(str(path))


def test_parquet_is_read_as_the_same_table_in_text_is(tmp_path):
    frame = pd.DataFrame({"time [s]": TIMES, "drive [V]": U, "position [m]": Y})
    table = parquet(tmp_path, frame)
    pd.testing.assert_frame_equal(table.frame, frame)
    assert sample_evenly(table).dt == 0.5


def test_an_index_of_times_in_parquet_gives_the_period(tmp_path):
    index = pd.date_range("2026-03-01", periods=4, freq="20ms", tz="Europe/Paris")
    sampled = sample_evenly(parquet(tmp_path, pd.DataFrame({"u": U, "y": Y}, index=index)))
    assert sampled.dt == pytest.approx(0.02, rel=1e-12)
    assert list(sampled.frame) == ["u", "y"]


def test_an_index_of_parquet_that_only_counts_is_no_column(tmp_path):
    assert list(parquet(tmp_path, pd.DataFrame({"u": U, "y": Y})[1:]).frame) == ["u", "y"]


def test_integers_flags_and_durations_of_parquet_are_numbers_and_words_are_told(tmp_path):
    frame = pd.DataFrame(
        {
            "count": pd.array([1, None, 3, 4], dtype="Int64"),
            "valve": [True, False, True, True],
            "since": pd.to_timedelta(TIMES, unit="s"),
            "state": ["on", "on", "off", None],
        }
    )
    table = parquet(tmp_path, frame)
    np.testing.assert_array_equal(table.frame["count"], [1, np.nan, 3, 4])
    np.testing.assert_array_equal(table.frame["valve"], [1, 0, 1, 1])
    np.testing.assert_array_equal(table.frame["since"], TIMES)
    assert table.stamped == {"since"}
    assert table.words == {"state": "on"}


def test_a_cell_of_parquet_that_is_no_number_is_named(tmp_path):
    with pytest.raises(
        DataError, match=r"record\.parquet, row 2 of the values, column 'u': 'x' is not a number"
    ):
        parquet(tmp_path, pd.DataFrame({"u": ["1", "x"], "y": [1.0, 2.0]}))


def test_a_damaged_parquet_file_is_named(tmp_path):
    pytest.importorskip("pyarrow", reason="parquet needs pyarrow")
    path = tmp_path / "cut.parquet"
    path.write_bytes(b"PAR1 and no more")
    with pytest.raises(DataError, match=r"cut\.parquet cannot be read as parquet: "):
        read_table(str(path))


def test_without_pyarrow_parquet_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    path = tmp_path / "record.parquet"
    path.write_bytes(b"PAR1")
    with pytest.raises(DataError, match=r'pip install "narx-sklearn\[parquet\]"'):
        read_table(str(path))


# ----------------------------------------------------------------------------------------------------------


def test_a_missing_file_and_bytes_that_are_no_text_are_told(tmp_path):
    with pytest.raises(DataError, match=r"Cannot read .*absent\.csv: No such file"):
        read_table(str(tmp_path / "absent.csv"))
    (tmp_path / "picture.csv").write_bytes(b"\x89PNG\0\0\0\1\2\3")
    with pytest.raises(DataError, match="is not text"):
        read_table(str(tmp_path / "picture.csv"))


@pytest.mark.parametrize("asked", ["drive [V]", "drive", "Drive", "2"])
def test_a_column_is_found_by_label_name_or_number(asked):
    assert find_column(["time [s]", "drive [V]"], asked, "--u") == "drive [V]"


def test_an_unknown_column_lists_the_columns():
    with pytest.raises(UsageError, match="--u motor names no column; the table has 'time', 'drive'"):
        find_column(["time", "drive"], "motor", "--u")
