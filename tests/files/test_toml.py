"""Any parser reads our TOML text as the values that it was made from."""

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cadtof_cli.capture.toml import load_metadata
from cadtof_cli.errors import MetadataError
from cadtof_cli.files.toml import read_toml, toml_from_tables

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
VALUES = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False),
    TEXT,
    st.lists(st.floats(allow_nan=False), max_size=4),
    st.lists(TEXT, max_size=4),
)
KEYS = st.from_regex(r"[a-z_]{1,8}", fullmatch=True)


@given(st.dictionaries(KEYS, st.dictionaries(KEYS, VALUES, max_size=4), max_size=3))
def test_python_reads_back_what_was_written(tables: dict[str, dict[str, Any]]) -> None:
    assert tomllib.loads(toml_from_tables(tables, comments=["made by a test", "twice"])) == tables


def test_text_as_people_like_to_read_it() -> None:
    tables: dict[str, dict[str, Any]] = {
        "modulation": {"periods_ns": (40.0, 20.0), "waveform": "sine"},
        "origin": {"captures": ["a", "µ/b"], "frames": np.int64(3), "k2_m": np.float64(0.5), "limit": math.inf},
    }
    assert toml_from_tables(tables, comments=("by hand",)) == (
        "# by hand\n\n"
        '[modulation]\nperiods_ns = [40.0, 20.0]\nwaveform = "sine"\n\n'
        '[origin]\ncaptures = [\n    "a",\n    "µ/b",\n]\nframes = 3\nk2_m = 0.5\nlimit = inf\n'
    )
    assert toml_from_tables({"pixel": {}}) == "[pixel]\n"


@pytest.mark.parametrize(
    ("content", "found"),
    [(None, "cannot be read: No such file"), (b"a = \xff", "not UTF-8 text (byte 4)"), (b"a = ", "not valid TOML: ")],
)
def test_the_message_for_bad_toml_says_what_is_wrong(content: bytes | None, found: str, tmp_path: Path) -> None:
    path = tmp_path / "capture.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(MetadataError) as caught:
        read_toml(path)
    assert str(caught.value).startswith(f"{path}: {found}")


@pytest.mark.parametrize(
    "key", ["a." * 100_000 + "a = 1", "[" + "a." * 100_000 + "a]", "b = { " + "a . " * 900 + "a = 1 }"]
)
def test_a_key_of_endless_parts_is_refused(key: str, tmp_path: Path) -> None:
    """A key of 60,000 bytes took a minute."""
    path = tmp_path / "capture.toml"
    path.write_text(key)
    with pytest.raises(MetadataError, match="found a key of more than 100 parts"):
        read_toml(path)


def test_a_long_list_of_numbers_on_one_line_is_no_key(tmp_path: Path) -> None:
    path = tmp_path / "response.toml"
    path.write_text(toml_from_tables({"target": {"distances_m": [0.5 + 0.25 * number for number in range(5000)]}}))
    assert len(read_toml(path)["target"]["distances_m"]) == 5000


def test_a_number_that_no_message_could_show_is_refused(tmp_path: Path) -> None:
    """It ended the command in a traceback."""
    path = tmp_path / "capture.toml"
    path.write_text(f"[pixel]\nintegration_length = 0x{'f' * 4000}")
    with pytest.raises(MetadataError, match="a number with thousands of digits"):
        load_metadata(path)
