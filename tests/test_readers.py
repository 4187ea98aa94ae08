"""Tables of text as instruments write them, and files that are none."""

import itertools
import tracemalloc

import numpy as np
import pytest

from cgfibre.errors import InputError
from cgfibre.readers import parse_table, read_table

WANT = np.array([[0.5, 1e-3], [1.25, -2.0], [3.0, 4e5]])


@pytest.mark.parametrize(
    ("text", "names", "units"),
    [
        ("x (mm),F (N)\n0.5,1e-3\n1.25,-2\n3,4e5\n", ("x", "F"), ("mm", "N")),
        ("x [mm];F [N]\n0,5;1e-3\n1,25;-2,0\n3;4E5\n", ("x", "F"), ("mm", "N")),
        ("x_mm\tF_N\n0.5\t0.001\n1.25\t-2\n3.0\t400000\n", ("x", "F"), ("mm", "N")),
        ("x / mm\tF / N\n0,5\t0,001\n1,25\t-2\n3,0\t400000\n", ("x", "F"), ("mm", "N")),
        ('"x","F"\r\n"mm","N"\r\n"0.5","0.001"\r\n"1.25","-2"\r\n"3","4e5"\r\n', ("x", "F"), ("mm", "N")),
        ("x F\n(mm) (N)\n0.5 0.001\n 1.25 -2\n3 4e5", ("x", "F"), ("mm", "N")),
        ("# pulling rig\n# x (mm)  F (N)\n0.5 0.001\n1.25 -2\n3 4e5", ("x", "F"), ("mm", "N")),
        ("0.5,0.001\n\n1.25,-2\n# pause\n3,4e5\n\n", ("column 1", "column 2"), ("", "")),
        ("x,F,\n0.5,1e-3,\n1.25,-2,\n3,4e5,\n", ("x", "F"), ("", "")),
    ],
)
def test_forms(text, names, units):
    table = parse_table(text.splitlines(keepends=True), "a file")
    assert table.values == pytest.approx(WANT)
    assert table.names == names and table.units == units


def test_notes_names_and_quantities():
    text = "Specimen: T700 12k\ntwist = 0,26 turn/cm\nlength;345 mm\n\nTime;Force (cN);Gap (mm)\n1;2;3\n2;4;5\n"
    table = parse_table(text.splitlines(), "a file")
    notes = {"specimen": "T700 12k", "twist": "0,26 turn/cm", "length": "345 mm"}
    assert {k: table.notes[k] for k in notes} == notes
    assert table.find(["thickness", "gap"]) == 2 and table.find(["width"]) is None
    assert table.index("FORCE", "--columns") == 1 and table.index("3", "--columns") == 2
    assert table.quantity(1, "nN", "") == pytest.approx([2e7, 4e7])
    assert table.quantity(2, "um", "") == pytest.approx([3000, 5000])
    assert table.quantity(0, "us", "s") == pytest.approx([1e6, 2e6])
    for call, key in (
        (lambda: table.quantity(0, "us", ""), "a file: unit of 'Time'"),
        (lambda: table.quantity(1, "um", ""), "a file: unit of 'Force'"),
        (lambda: table.index("width", "--columns"), "--columns"),
    ):
        with pytest.raises(InputError) as caught:
            call()
        assert caught.value.key == key


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("", "empty"),
        ("\n\n \n", "empty"),
        ("x,F\n", "x,F"),
        ("just words\nand more of them\n", "just words"),
        ("x,F\n1,2\n3,nan\n", "3,nan"),
        ("x,F\n1,2\n3,inf\n", "3,inf"),
        ("x,F\n1,2\n3,\n4,5\n", "3,"),
        ("x,F\n1,2\n3,4,5\n", "3,4,5"),
        ("x,F\n1,2\n3,stop\n", "3,stop"),
        ("1\n2\n3\n", "1"),
    ],
)
def test_what_is_no_table_is_named_in_one_line(text, wrong, tmp_path):
    path = tmp_path / "data.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_table(path)
    assert caught.value.key.startswith("data.csv") and wrong in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "binary").write_bytes(bytes(range(256)) * 10)
    for name in ("none.csv", "binary", "."):
        with pytest.raises(InputError):
            read_table(tmp_path / name)


def test_long_tables_are_folded():
    n = 70_001
    lines = itertools.chain(["t (s),F (N)\n"], (f"{i},{2 * i + 1}\n" for i in range(n)))
    table = parse_table(lines, "a file", most=1000)
    assert 500 < len(table) <= 1000
    k = round(table.values[1, 0] - table.values[0, 0])
    assert table.values[:3, 0] == pytest.approx((k - 1) / 2 + k * np.arange(3))
    assert table.values[:, 1] == pytest.approx(2 * table.values[:, 0] + 1)


def test_rows_stream(tmp_path):
    """A million rows are held as numbers, never as text."""
    path = tmp_path / "long.csv"
    n = 40_000
    with path.open("w") as f:
        f.write("t (s),F (N)\n")
        f.writelines(f"{i},{2 * i}\n" for i in range(n))
    tracemalloc.start()
    table = read_table(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(table) == n and table.values[-1] == pytest.approx([n - 1, 2 * n - 2])
    assert peak < 3 * table.values.nbytes + 1.5e7
