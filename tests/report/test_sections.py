"""The tables of a page: which frames they list, and what rounding loses."""

import numpy as np

from cadtof_cli.report.frames import embedded_frame
from cadtof_cli.report.sections import LISTED_FAILURES, FrameLine, PageText, embedded_section, failures, frame_table


def test_the_rounding_of_the_truth_is_stated() -> None:
    """65533 steps from 1 m to 3 m are .0305 mm each; the page promises the largest rounding of each layer, half a step."""
    depth, truth = (
        embedded_frame({name: np.linspace(1.0, most, 12).reshape(3, 4)}, step=1)
        for name, most in (("direct.depth", 2.0), ("truth", 3.0))
    )
    with_truth, without = str(embedded_section([depth], [truth])), str(embedded_section([depth], []))
    assert "0.015 mm" in with_truth
    assert "0.0076 mm" in with_truth
    assert "the roundings of both" in with_truth
    assert "0.015 mm" not in without
    assert "the roundings of both" not in without


def test_of_thousands_of_failed_frames_the_first_are_listed() -> None:
    lost = [FrameLine(f"lost {number}", "failed", "no light") for number in range(2000)]
    page = PageText("run", "", frames=(FrameLine("whole", "ok", number=0), *lost))
    for markup in (failures(page), frame_table(page)):
        assert str(markup).count("no light") == LISTED_FAILURES
        assert "lost 499<" in str(markup)
        assert "lost 500<" not in str(markup)
    assert "2000 failed, 0 skipped; the first 500 of them" in str(failures(page))
    assert "501 of 2001 frames" in str(frame_table(page))
