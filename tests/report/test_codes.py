"""Codes of a page, decoded by the tests' own code: values change by no more than the stated rounding error."""

import base64
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from cadtof_cli.report.codes import Codes, Scale, coded_bits, coded_values, packed

PLANES = arrays(
    np.float32,
    (5, 7),
    elements=st.one_of(
        st.floats(width=32, min_value=-(2.0**60), max_value=2.0**60, allow_subnormal=False),
        st.sampled_from([np.nan, np.inf]),
    ),
)


def _read(codes: Codes, scale: Scale) -> NDArray[np.float64]:
    values = scale.first + (codes.astype(float) - 1.0) * scale.step
    values = np.exp(values) if scale.kind == "log" else values
    values[codes == 0] = np.nan
    values[codes == 65535] = np.inf
    return values


@given(PLANES, st.booleans())
def test_no_value_moves_by_more_than_is_stated(plane: NDArray[np.float32], is_depth: bool) -> None:
    codes, scale = coded_values(plane, is_depth=is_depth)
    read = _read(codes, scale)
    np.testing.assert_array_equal(np.isnan(read), np.isnan(plane))
    np.testing.assert_array_equal(np.isinf(read), np.isinf(plane))
    finite = np.isfinite(plane)
    exact = plane[finite].astype(float)
    allowed = scale.loss * (np.abs(exact) if scale.kind == "log" else 1.0) + 1e-12 * np.abs(exact).max(initial=0.0)
    assert (np.abs(read[finite] - exact) <= allowed).all()


def test_depths_have_even_steps_and_wide_layers_those_of_their_logarithm() -> None:
    values = np.array([[1e-4, 1.0, 6.0]], np.float32)
    _, even = coded_values(values, is_depth=True)
    assert even.kind == "linear"
    assert even.step == pytest.approx(6.0 / 65533, rel=1e-4)
    assert even.loss == pytest.approx(45.8e-6, rel=1e-2)  # 0.05 mm over the range of the paper's camera
    codes, wide = coded_values(values, is_depth=False)
    assert wide.kind == "log"
    assert codes[0, 0] == 1
    assert codes[0, 2] == 65534
    assert wide.loss < 1e-4


def test_a_plane_without_an_answer_and_a_plane_with_one_value_have_no_loss() -> None:
    codes, scale = coded_values(np.full((2, 2), np.nan), is_depth=True)
    assert not codes.any()
    assert scale.loss == 0.0
    codes, scale = coded_values(np.full((2, 2), 3.25), is_depth=True)
    np.testing.assert_array_equal(_read(codes, scale), 3.25)


@given(arrays(np.uint32, (4, 6)))
def test_bits_lose_nothing(status: NDArray[np.uint32]) -> None:
    codes, scale = coded_bits(status)
    np.testing.assert_array_equal(np.array(scale.values)[codes.astype(int) - 1], status)
    assert scale.loss == 0.0


@given(arrays(np.uint16, (2, 4, 6)))
def test_packed_planes_come_back(planes: Codes) -> None:
    data = zlib.decompress(base64.b64decode(packed(list(planes))))
    assert len(data) == 2 * planes.size
    for number, plane in enumerate(planes):
        high, low = (np.frombuffer(data, np.uint8, 24, 48 * number + start).astype(np.uint16) for start in (0, 24))
        np.testing.assert_array_equal(np.cumsum((high << 8) + low, dtype=np.uint16).reshape(4, 6), plane)
