"""Reading recordings: what is found out by itself, and what every mistake is called."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.cli._sampling import find_column, sample_evenly
from narx_sklearn.cli._tables import read_table

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


def test_iso_time_stamps_give_the_period(tmp_path):
    rows = "\n".join(f"2026-03-01T12:00:0{k // 2}.{5 * (k % 2)}00Z;{k},5" for k in range(8))
    sampled = sample_evenly(read_table(written(tmp_path, "when;u\n" + rows)))
    assert sampled.dt == pytest.approx(0.5, rel=1e-12)
    assert list(sampled.frame) == ["u"]


@pytest.mark.parametrize(("unit", "seconds"), [("s", 0.5), ("ms", 0.5e-3), ("min", 30.0)])
def test_time_counts_in_the_unit_of_its_header(tmp_path, unit, seconds):
    text = record(",", ".", header=f"time [{unit}]{{0}}u{{0}}y\n")
    assert sample_evenly(read_table(written(tmp_path, text))).dt == pytest.approx(seconds, rel=1e-12)


def test_a_gap_in_time_begins_another_session(tmp_path):
    text = record(",", ".", times=[0.0, 0.5, 5.0, 5.5])
    sampled = sample_evenly(read_table(written(tmp_path, text)))
    assert sampled.dt == pytest.approx(0.5)
    assert sampled.sessions.tolist() == [0, 0, 1, 1]
    assert any("1 gap in time" in note for note in sampled.notes)


def test_uneven_sampling_is_refused_with_a_way_out_and_resampled_on_demand(tmp_path):
    table = read_table(written(tmp_path, record(",", ".", times=[0.0, 0.5, 1.2, 1.5])))
    with pytest.raises(DataError, match=r"uneven: steps .* between 0\.3 s and 0\.7 s.*--resample"):
        sample_evenly(table)
    sampled = sample_evenly(table, resample=0.25)
    np.testing.assert_allclose(sampled.frame["drive [V]"][:3], [0.5, -0.375, -1.25])  # half way, by hand
    assert sampled.dt == 0.25
    assert len(sampled.frame) == 7


def test_resampling_fills_no_missing_value(tmp_path):
    table = read_table(written(tmp_path, "t,u\n0,1\n1,\n2,3\n3,4\n"))
    resampled = sample_evenly(table, resample=0.5).frame["u"].to_numpy()
    assert np.isnan(resampled[1:4]).all()
    assert np.isfinite(resampled[[0, 4, 5, 6]]).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("u,y\n", "no line of values|does not look like a table"),
        ("hello\nworld\n", "does not look like a table of numbers"),
        ("u,y\n1,2\n3,x4\n5,6\n7,8\n", r"line 3, column 'y': 'x4' is not a number"),
        ("u,y\n1,2\n3,4,5\n6,7\n8,9\n", "line 3 has 3 values, the lines before 2"),
        ("u,u\n1,2\n3,4\n", "two columns named 'u'"),
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
