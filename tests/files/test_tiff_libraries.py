"""Frames are the same whether tifffile gives series in the way it does from 2026.5 on, or in the way it did before."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from cadtof_cli.capture.frames import read_stored
from cadtof_cli.files.frames import FrameLayout
from tests.files.forms import Writer, known_frame, planes_of, tiff


class Expanded:
    """A series as from 2026.5 on: its attributes have all axes, and the methods that gave them before are gone."""

    def __init__(self, series: Any) -> None:
        self.axes, self.shape = series.get_axes(squeeze=False), series.get_shape(squeeze=False)
        self._series = series

    def __getattr__(self, name: str) -> Any:
        if name in {"get_axes", "get_shape"}:
            raise AttributeError(name)
        return getattr(self._series, name)

    def __iter__(self) -> Any:
        return iter(self._series)

    def __len__(self) -> int:
        return len(self._series)


class Series:
    """`TiffFile.series` as from 2026.5 on: a function that returns the series."""

    def __init__(self, series: list[Any]) -> None:
        self._series = series

    def __call__(self, *, squeeze: bool) -> list[Any]:
        assert not squeeze
        return [Expanded(one) for one in self._series]


FORMS = {
    "pages": tiff(arrange=planes_of),
    "an axis of length 1": tiff(arrange=lambda frame: frame[np.newaxis], metadata={"axes": "TZCYX"}),
    "ImageJ": tiff(imagej=True, metadata={"axes": "ZCYX"}),
    "OME": tiff(ome=True, metadata={"axes": "TCYX"}),
    "scattered": tiff(arrange=lambda frame: frame.transpose(2, 3, 0, 1), metadata={"axes": "YXZC"}),
}


@pytest.mark.parametrize("write", FORMS.values(), ids=FORMS)
def test_frames_are_the_same_by_either_kind_of_series(
    write: Writer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = known_frame("u2")
    source = write(tmp_path / "frame", frame)
    np.testing.assert_array_equal(read_stored(source, FrameLayout((1, 2))), frame)
    if not hasattr(tifffile.TiffPageSeries, "get_axes"):
        return
    given: Any = vars(tifffile.TiffFile)["series"].func
    monkeypatch.setattr(tifffile.TiffFile, "series", property(lambda file: Series(given(file))))
    copy = write(tmp_path / "another", frame[..., ::-1])
    np.testing.assert_array_equal(read_stored(copy, FrameLayout((1, 2))), frame[..., ::-1])
