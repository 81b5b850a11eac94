"""`cadtof sweep`: the table, the pictures, and what is refused."""

import csv
import io
from pathlib import Path

import pytest

from tests.support.run_cadtof import cadtof

SMALL = ("--asr", "1,4", "--mpi", "0,0.3", "--integration-length", "log:1e3:1e5:3", "--runs", "60")


def table(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_a_row_for_every_condition() -> None:
    done = cadtof("sweep", *SMALL, "--jobs", 1)
    assert (done.status, done.err) == (0, "")
    rows = table(done.out)
    conditions = [(row["mpi_ratio"], row["asr"], row["integration_length"]) for row in rows]
    assert conditions == [(m, a, n) for m in ("0", "0.3") for a in ("1", "4") for n in ("1000", "10000", "100000")]
    for row in rows:
        if row["mpi_ratio"] == "0":
            assert row["second_true_ns"] == row["second_std_ns"] == ""
        if row["integration_length"] == "100000":
            assert abs(float(row["direct_bias_ns"])) < 0.05
        error = float(row["confidence_v"]) / float(row["confidence_model_v"]) - 1
        assert abs(error) < 0.05


def test_noise_falls_with_the_root_of_the_integration_length() -> None:
    rows = table(cadtof("sweep", *SMALL, "--jobs", 1).out)
    short, long = (
        next(row for row in rows if (row["asr"], row["mpi_ratio"], row["integration_length"]) == ("1", "0.3", n))
        for n in ("1000", "100000")
    )
    assert float(short["direct_bound_ns"]) / float(long["direct_bound_ns"]) == pytest.approx(10.0, rel=0.01)
    assert float(short["phase_std_rad"]) / float(long["phase_std_rad"]) == pytest.approx(10.0, rel=0.4)


@pytest.mark.parametrize("way", [(), ("--photons",)])
def test_same_seed_same_bytes_for_any_number_of_processes(way: tuple[str, ...]) -> None:
    grid = ("--asr", "1:3:3", "--mpi", "0.2", "--integration-length", "100,300", "--runs", "23", *way)
    assert cadtof("sweep", *grid, "--jobs", 1).out == cadtof("sweep", *grid, "--jobs", 2).out


def test_a_sweep_writes_a_table_and_pictures(tmp_path: Path) -> None:
    done = cadtof("sweep", *SMALL, "--jobs", 1, "-o", tmp_path / "s.csv", "--plot", tmp_path / "maps")
    assert (done.status, done.out) == (0, "")
    assert len(table((tmp_path / "s.csv").read_text())) == 12
    pictures = sorted((tmp_path / "maps").iterdir())
    assert [path.name for path in pictures] == ["bias.png", "first_phasor.png", "std.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in pictures)


BAD_INPUT = [
    (("--asr", "1:6"), "--asr: found '1:6', expected 1,2,5 or start:stop:n or log:start:stop:n"),
    (("--asr", "1:6:0"), "--asr: found '0' steps in '1:6:0', expected 1 to 10000"),
    (("--mpi", "a"), "--mpi: found 'a' in 'a', expected a number"),
    (("--integration-length", "log:0:1e5:3"), "--integration-length: found 'log:0:1e5:3', expected ends above 0"),
    (("--asr", "-1,2"), "ASR: found -1, expected a ratio from 0 to 1e+12"),
    (("--asr", "2,-1"), "ASR: found -1, expected a ratio from 0 to 1e+12"),
    (("--mpi", "0.1,-0.1"), "MPI ratio: found -0.1, expected a ratio from 0 to 1e+12"),
    (("--integration-length", "1000,1"), "integration length: found 1, expected a number above 1"),
    (("--asr", "1:6:1000", "--mpi", "0:1:1000"), "grid: found 5000000 conditions, expected 1 to 100000"),
    (("--second", "50"), "second: found 50 ns, a separation of 45 ns"),
    (("--photons", "--dead-time", "50"), "dead time: found 50 ns, expected 0 to less than one cycle of 40 ns"),
    (("--capacitors", "1,2,3"), "capacitors: found 3 values, expected 12"),
    (("--jobs", "-2"), "--jobs: found -2, expected 1 or more"),
]


@pytest.mark.parametrize(("arguments", "message"), BAD_INPUT)
def test_bad_input_gets_a_clear_error(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    done = cadtof("sweep", *arguments, "-o", tmp_path / "s.csv")
    assert message in done.err
    assert "Traceback" not in done.err
    assert (done.status, done.out) == (2, "")
    assert list(tmp_path.iterdir()) == []


def test_an_out_that_exists_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text("mine")
    done = cadtof("sweep", *SMALL, "-o", tmp_path / "s.csv")
    assert f"{tmp_path / 's.csv'}: found a file, expected nothing there" in done.err
    assert done.status == 2
    assert (tmp_path / "s.csv").read_text() == "mine"


def test_three_harmonics_and_three_paths(tmp_path: Path) -> None:
    three = ("--periods-ns", "40,20,13.3333", "--paths", "3", "--path", "0.2@27", "--integration-length", "1e6")
    done = cadtof(
        "sweep", "--asr", "2,4", "--mpi", "0.4", "--runs", "40", *three, "--jobs", 1, "--plot", tmp_path / "p"
    )
    assert done.status == 0
    for row in table(done.out):
        assert row["path3_true_ns"] == "27"
        assert float(row["path3_std_ns"]) == pytest.approx(float(row["path3_bound_ns"]), rel=0.5)
        assert row["steps_per_start"] == ""
    assert (tmp_path / "p" / "std.png").exists()


def test_a_sweep_as_the_paper_made_it_scatters_as_the_paper_says() -> None:
    ways = ("--solver", "lm", "--order", "2", "--no-pulse-correction", "--wrapped", "--return", "strongest")
    grid = ("--asr", "6", "--mpi", "0.1", "--integration-length", "1e3", "--runs", "400")
    (row,) = table(cadtof("sweep", *grid, *ways, "--jobs", 1).out)
    assert float(row["second_std_ns"]) == pytest.approx(12.8, abs=1.0)
    assert 5 < float(row["steps_per_start"]) < 40


def test_a_sweep_of_a_moving_target() -> None:
    """Twice the error at 30 frames per second (`test_simulate.py`), and negative, because the target comes nearer."""
    grid = ("--asr", "1", "--mpi", "0", "--integration-length", "1e6", "--order", "1", "--jobs", 1)
    (still,), (fast,) = (
        table(cadtof("sweep", *grid, *way).out) for way in ((), ("--speed", "-2", "--frame-rate", "15"))
    )
    assert float(fast["direct_bias_ns"]) - float(still["direct_bias_ns"]) == pytest.approx(-0.6 * 0.2224, abs=0.005)
