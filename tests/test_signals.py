"""Signal files: how instruments write them, what is wrong with them, what is left behind; the verb ``signal``."""

import json
import re
import tracemalloc

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from friction_signals import FREQUENCY, T1, WRAP, stick_slip_signal

from cgfibre.cli import main
from cgfibre.errors import InputError
from cgfibre.readers import Wanted, read_record
from cgfibre.signals import DISPLACEMENT, FORCE, TIME, SignalOptions, analyse_signals

COLUMNS = (TIME, DISPLACEMENT, FORCE)
T, F = stick_slip_signal(0)


def text_of(columns, header="", delimiter=",", decimal=".", form="%.6f"):
    rows = "\n".join(delimiter.join(form % v for v in row) for row in np.column_stack(columns))
    return header + (rows.replace(".", decimal) if decimal != "." else rows) + "\n"


def write(path, text, encoding="utf-8"):
    path.write_bytes(text.encode(encoding))
    return path


def read(path, **options):
    return read_record(path, COLUMNS, rising="time", **options)


# --- the same signal as instruments write it -------------------------------------------------------------------------

ONE = np.column_stack([T, 0.16 * T, F])
DIALECTS = {
    "plain": (text_of((T, 0.16 * T, F), "time,displacement,force\n"), "utf-8"),
    "without a header": (text_of((T, 0.16 * T, F)), "utf-8"),
    "other order and units": (
        text_of((F * 1e3, T / 60, 0.016 * T), "Load (mN),Time (min),Extension (cm)\n", form="%.9f"),
        "utf-8",
    ),
    "german instrument": (
        text_of((T, 0.16 * T, 100 * F), "Prüfung;17\nDatum;26.11.2026\n\nZeit;Weg;Kraft\n(s);(mm);(cN)\n", ";", ","),
        "latin-1",
    ),
    "tabs, byte order mark": (text_of((T, 0.16 * T, F), "Time [s]\tCrosshead [mm]\tForce [N]\n", "\t"), "utf-8-sig"),
    "utf-16": (text_of((T, 0.16 * T, F), "Time [s]\tCrosshead [mm]\tForce [N]\n", "\t"), "utf-16"),
    "spaces": (text_of((T, 0.16 * T, F), "# Time (s)   Displ (mm)   Load (N)\n", "  "), "utf-8"),
    "decimal commas, spaces": (text_of((T, 0.16 * T, F), "t d f\n", " ", ","), "utf-8"),
    "quoted": (
        '"Time (s)","Displ (mm)","Load (N)"\n'
        + "".join(f'"{a:.6f}","{0.16 * a:.6f}","{b:.6f}"\n' for a, b in zip(T, F, strict=True)),
        "utf-8",
    ),
    "suffixes": (text_of((T * 1e6, 160 * T, F), "time_us,displacement_um,force_N\n"), "utf-8"),
    "more columns": (
        text_of(
            (np.arange(len(T)), T, 25 + 0 * T, 0.16 * T, F), "No,Time (s),Temperature (C),Position (mm),Load (N)\n"
        ),
        "utf-8",
    ),
    "windows line ends, delimiter at the end": (
        text_of((T, 0.16 * T, F), "time;displacement;force\n", ";").replace("\n", ";\r\n"),
        "utf-8",
    ),
    "a longer header": ("Tested by NN\n" + "Rate,10\n" * 80 + text_of((T, 0.16 * T, F), "\n"), "utf-8"),
}


@pytest.mark.parametrize("name", DIALECTS)
def test_one_signal_in_many_dialects(tmp_path, name):
    text, encoding = DIALECTS[name]
    r = read(write(tmp_path / "x.txt", text, encoding))
    found = np.column_stack([r.columns[w.name] for w in COLUMNS])
    assert found == pytest.approx(ONE, rel=1e-4, abs=2e-6)
    assert (r.rows, r.missing, r.folded) == (len(T), 0, 1)


def test_columns_and_units_by_option(tmp_path):
    path = write(tmp_path / "x.csv", text_of((F, T, 0.16 * T), "A,B,C\n"))
    for columns in (("B", "C", "A"), ("b", "c", "a"), ("2", "3", "1")):
        assert read(path, columns=columns).columns["force"] == pytest.approx(F, abs=1e-5)
    assert read(path, columns=("B", "A")).columns["force"] == pytest.approx(F, abs=1e-5)
    r = read(path, columns=("B", "C", "A"), given_units=("ms", "m", "kN"))
    assert r.columns["time"] == pytest.approx(T * 1e-3, abs=1e-5) and r.columns["force"][0] == pytest.approx(F[0] * 1e3)
    assert "assumed" in read(path, columns=("B", "C", "A")).notes[0]
    for bad, key in (
        ({"columns": ("B", "X", "A")}, "--columns"),
        ({"columns": ("B",)}, "--columns"),
        ({"columns": ("B", "C", "4")}, "--columns"),
        ({"columns": ("B", "C", "A"), "given_units": ("s", "N", "N")}, "--units"),
        ({"columns": ("B", "C", "A"), "given_units": ("s",)}, "--units"),
    ):
        with pytest.raises(InputError) as info:
            read(path, **bad)
        assert info.value.key == key


def test_rows_without_numbers_are_left_out_and_counted(tmp_path):
    lines = text_of((T, 0.16 * T, F), "time,displacement,force\n").splitlines()
    lines[30:30] = ["5.0,nan,nan", "5.0,,", "", "overload"]
    lines.append("End of test")
    r = read(write(tmp_path / "x.csv", "\n".join(lines)))
    assert len(r) == len(T) and r.missing == 4 and r.columns["force"] == pytest.approx(F, abs=1e-6)
    assert "4 of 1297 rows left out (line 31 reads '5.0,nan,nan')" in r.notes[-1]


# --- what is wrong with a file ---------------------------------------------------------------------------------------

ROWS = text_of((T, 0.16 * T, F))
BAD = {
    "empty": (b"", "empty"),
    "blank lines": (b"\n\n  \n", "empty"),
    "a header alone": (b"time,displacement,force\n", "a table of numbers"),
    "words": (b"once upon a time\nthere was a tow\n", "a table of numbers"),
    "binary": (bytes(range(256)) * 20, "binary"),
    "one sample": (b"time,force\n1,2\n", "at least 16 samples"),
    "one column": (b"force\n1\n2\n3\n", "columns of time and force"),
    "wrong columns": (b"a,b\n" + b"1,2\n" * 30, "name it with --columns"),
    "columns without names": (b"1,2,3,4\n" * 30, "--columns with 3 numbers"),
    "time that goes back": (b"time,force\n" + b"1,2\n" * 20 + b"0.5,2\n" + b"2,2\n" * 20, "0.5 after 1 in line 22"),
    "no number anywhere": (b"time,force\n" + b"1,2\n" * 3 + b"1,nan\n" * 40, "line 5 reads '1,nan'"),
    "mass for force": (b"time (s),load (g)\n" + b"1,2\n" * 30, "unit of force such as N"),
    "an unknown unit": (b"time (s),load (foo)\n" + b"1,2\n" * 30, "--units overrules the file"),
    "time that stands still": (b"time,force\n" + b"1,2\n" * 30, "times that differ"),
    "negative tensions": (ROWS.replace(",0.", ",-0.").encode(), "positive tensions"),
    "a line without end": (b"1" * (1 << 21), "a million characters"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_one_line_exit_2_and_nothing_written(tmp_path, monkeypatch, name):
    content, part = BAD[name]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.csv").write_bytes(content)
    done = CliRunner().invoke(main, ["signal", "bad.csv", "--input-tension", "0.52 N", "--wrap", "2.87 rad"])
    assert done.exit_code == 2, done.output
    assert len(done.stderr.strip().splitlines()) == 1 and part in done.stderr and done.stdout == ""
    assert [p.name for p in tmp_path.iterdir()] == ["bad.csv"]


GOOD = ("--input-tension", "0.52 N", "--wrap", "2.87 rad")


@pytest.mark.parametrize(
    "arguments, named",
    [
        (("nowhere.csv", *GOOD), "no such file"),
        ((".", *GOOD), "is a directory"),
        (("x.csv", "--input-tension", "0.52", "--wrap", "2.87 rad"), "--input-tension"),
        (("x.csv", "--input-tension", "0 N", "--wrap", "2.87 rad"), "above 0"),
        (("x.csv", "--input-tension", "0.52 N", "--wrap", "2.87 mm"), "--wrap"),
        (("x.csv", *GOOD, "--window", "10 s"), "FROM:TO"),
        (("x.csv", *GOOD, "--window", "10:20"), "--window"),
        (("x.csv", *GOOD, "--window", "20 s:10 s"), "FROM below TO"),
        (("x.csv", *GOOD, "--window", "900 s:901 s"), "the record spans"),
        (("x.csv", *GOOD, "--columns", "time,x,force"), "--columns"),
        (("x.csv", *GOOD, "--band", "1 s:2 s"), "--band"),
        (("x.csv", *GOOD, "--speed", "10 mm"), "--speed"),
        (("x.csv", "x.csv", "x.csv", *GOOD, "--wrap", "3 rad"), "--wrap"),
        (("x.csv", *GOOD, "--angle", "20 deg", "--tow", "100"), "filaments"),
        (("x.csv", *GOOD, "--out", "x.csv"), "a folder, not a file"),
        (("x.csv", "bad.csv", *GOOD), "bad.csv"),
    ],
)
def test_a_wrong_option_is_one_line_and_nothing_written(tmp_path, monkeypatch, arguments, named):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "x.csv", text_of((T, 0.16 * T, F), "time,displacement,force\n"))
    write(tmp_path / "bad.csv", "time,force\n1,2\n")
    done = CliRunner().invoke(main, ["signal", *arguments])
    assert done.exit_code == 2, done.output
    assert len(done.stderr.strip().splitlines()) == 1 and named in done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.csv", "x.csv"]


def test_long_files_are_read_in_bounded_memory(tmp_path):
    n, limit = 200_000, 2**12
    t = np.arange(n) * 1e-3
    path = tmp_path / "long.csv"
    np.savetxt(path, np.column_stack([t, 1 + 0 * t, np.sin(0.05 * t)]), fmt="%.6f", delimiter=",")
    tracemalloc.start()
    r = read(path, limit=limit)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert r.rows == n and len(r) <= limit and r.folded == 64 and "64 consecutive rows averaged" in r.notes[-1]
    assert np.mean(r.columns["time"]) == pytest.approx(t.mean(), rel=1e-3)
    assert r.columns["force"] == pytest.approx(np.sin(0.05 * r.columns["time"]), abs=1e-4)
    assert peak < 30e6  # a block of 100 000 lines of text; the file is 5 MB


def test_a_wanted_column_that_may_be_missing(tmp_path):
    path = write(tmp_path / "x.csv", "zeit;kraft\n" + "1;2\n" * 20)
    assert set(read(path).columns) == {"time", "force"}
    path = write(tmp_path / "y.csv", "zeit;kraft;farbe\n" + "1;2;3\n" * 20)
    extra = Wanted("width", "mm", ("width",))
    with pytest.raises(InputError, match="a column of the width"):
        read_record(path, (TIME, FORCE, extra))


# --- the verb --------------------------------------------------------------------------------------------------------


def test_the_verb_prints_coefficients_and_lines_and_leaves_tables_and_pictures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "x.csv", text_of((T, 0.16 * T, F), "time,displacement,force\n"))
    options = ("--columns", "time,displacement,force", "--window", "10 s:170 s", "--angle", "90 deg")
    call = ["signal", "x.csv", *GOOD, *options]
    done = CliRunner().invoke(main, call)
    assert done.exit_code == 0, done.output
    found = {m[1]: float(m[2]) for m in re.finditer(r"(mu|mu_s|mu_k|line) +(\d\.\d+)", done.stdout)}
    assert found["mu_s"] == pytest.approx(0.18, abs=2.5e-3) and found["mu_k"] == pytest.approx(0.16, abs=2.5e-3)
    first_line = re.search(r"line +(\S+) \+- (\S+) Hz", done.stdout)
    assert float(first_line[1]) == pytest.approx(FREQUENCY, abs=0.005) and "Table 3-1: 0.230 +- 0.004" in done.stdout
    out = tmp_path / "results" / "signal-x"
    names = {"signal-x.png", "spectrum-x.png", "spectrum-x.csv", "trials.csv", "summary.json", "signal.h5"}
    assert {p.name for p in out.iterdir()} == names
    summary = json.loads((out / "summary.json").read_text(), parse_constant=pytest.fail)
    trial = summary["trials"][0]
    assert trial["frequency_Hz"] == pytest.approx(FREQUENCY, abs=0.005) and trial["mu_s0"] is None
    assert all(v == pytest.approx(FREQUENCY, abs=0.005) for v in trial["peaks_Hz"].values())
    with h5py.File(out / "signal.h5") as f:
        assert f["signal-x/force_N"].attrs["units"] == "N" and len(f["signal-x/time_s"]) == len(T)
    again = CliRunner().invoke(main, call)
    assert again.exit_code == 2 and "--force" in again.stderr
    assert CliRunner().invoke(main, [*call, "--force"]).exit_code == 0


def test_trials_have_a_mean_and_wraps_a_regression(tmp_path):
    paths = []
    for k, wrap in enumerate((2.87, 2.87, 3.57, 4.92)):
        t, f = stick_slip_signal(k, wrap=wrap, n=600, span=80.0)
        paths.append(write(tmp_path / f"w{k}.csv", text_of((t, f), "time,force\n")))
    r = analyse_signals(paths, SignalOptions((T1,), (2.87, 2.87, 3.57, 4.92), out=tmp_path / "o"))
    assert r.means[2.87, 1]["mu"].n == 2 and r.means[3.57, 1]["mu"].n == 1
    line = r.regression[1]
    assert line.mu == pytest.approx(0.1706, abs=1e-3) and line.n == 4 and line.interval < 2e-3
    assert (tmp_path / "o" / "belt-law.png").exists() and (tmp_path / "o" / "trials.png").exists()
    one = analyse_signals(paths[:2], SignalOptions((T1,), (2.87,)))
    assert one.out is None and not one.regression and one.means[2.87, 1]["mu_s"].interval < 5e-3


def test_up_and_down_in_one_record_and_time_from_the_travel(tmp_path):
    t = np.linspace(0, 60, 1200)
    half = len(t) // 2
    d = np.where(t < 30, t, 60 - t) / 6
    force = np.where(t < 30, T1 * np.exp(0.21 * WRAP), T1 * np.exp(-0.21 * WRAP))
    rng = np.random.default_rng(0)
    force = force * (1 + 0.003 * rng.normal(size=len(t)))
    path = write(tmp_path / "loop.csv", text_of((t, d, 1.1 * force), "time,displacement,force\n"))
    r = analyse_signals([path], SignalOptions((T1,), (WRAP,)))
    assert [x.friction.direction for x in r.trials] == [1, -1]
    assert r.loops == pytest.approx([0.21], abs=2e-3)  # 1.1: a load that is not known as well as it should be
    assert r.trials[0].friction.mu > 0.23 > 0.19 > r.trials[1].friction.mu
    alone = write(tmp_path / "travel.csv", text_of((d[:half], force[:half]), "Extension (mm),Load (N)\n"))
    s = analyse_signals([alone], SignalOptions((T1,), (WRAP,), speed=1 / 6))
    assert s.trials[0].time[-1] == pytest.approx(t[half - 1], abs=0.1)
    with pytest.raises(InputError, match="--window"):
        analyse_signals([path], SignalOptions((T1,), (WRAP,), window=(1.0, 9.0)))


def test_doubtful_input_is_noted(tmp_path):
    path = write(tmp_path / "x.csv", text_of((T, F * (1 + 0.0012 * T)), "time,force\n"))
    r = analyse_signals([path], SignalOptions((T1 * 1e-3,), (WRAP,), window=(5.0, 175.0)))
    assert any("check the units" in n for n in r.notes) and any("drifts" in n for n in r.notes)
