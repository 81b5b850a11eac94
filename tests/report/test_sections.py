"""The tables of a page: which frames they list, and what rounding loses. The colours of its bar of shares."""

import re
from importlib.resources import files

import matplotlib as mpl
import numpy as np

from cadtof_cli.figures.pixel_classes import PixelClass
from cadtof_cli.report.colours import palette
from cadtof_cli.report.frames import embedded_frame
from cadtof_cli.report.sections import LISTED_FAILURES, FrameLine, PageText, embedded_section, failures, frame_table
from tests.support.vision import SEEN, apart, contrast, rgb


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


def _colours() -> tuple[dict[str, str], dict[str, str]]:
    """Return the light and the dark colours of the page by name."""
    style = (files("cadtof_cli.report") / "page" / "page.css").read_text("utf-8")
    light, dark = (
        dict(re.findall(r"--([\w-]+): (#\w{6});", block)) for block in re.findall(r":root \{([^}]*)\}", style)[:2]
    )
    assert dark["card"] != light["card"]
    return light, light | dark


def test_the_bar_of_shares_is_seen_on_its_ground() -> None:
    """WCAG 2.1, 1.4.11: a contrast of 3 or more, in light and in dark colours."""
    for colours in _colours():
        for name in (f"share-{number}" for number in range(5)):
            assert contrast(colours[name], colours["card"]) >= 3.0, name


def test_colours_of_shares_and_of_no_answer_are_told_apart_by_everybody() -> None:
    for colours in _colours():
        shares = rgb(*(colours[f"share-{number}"] for number in range(5)))
        for seen in SEEN:
            distances = apart(shares, shares, seen)[np.triu_indices(5, 1)]
            assert distances.min() > (5.0 if seen == "in black and white" else 12.0), seen
    none = rgb(palette()["no_answer"])
    for scale in ("viridis", "RdBu_r"):
        colours_of_scale = mpl.colormaps[scale](np.linspace(0.0, 1.0, 256))[:, :3]
        # in black and white, no grey can be missing in a scale from dark to bright
        for seen in SEEN.keys() - {"in black and white"}:
            assert apart(none, colours_of_scale, seen).min() > 12.0, (scale, seen)


def test_a_kind_of_pixel_has_the_hue_of_pictures_on_the_page() -> None:
    """Orange is diffuse MPI in `cadtof preview`; who looks at both must not take it for two paths here."""
    kinds = (PixelClass.TWO_PATHS, PixelClass.MORE_PATHS, PixelClass.DIFFUSE)
    pictures = rgb(*(kind.colour for kind in kinds))
    for colours in _colours():
        shares = rgb(*(colours[f"share-{number}"] for number in (1, 2, 3)))
        assert apart(shares, pictures, "by most people").argmin(axis=1).tolist() == [0, 1, 2]
    overlays = rgb(*(palette()["status"][name] for name in ("TWO_PATHS", "DIFFUSE_MPI")))
    assert apart(overlays, pictures[[0, 2]], "by most people").argmin(axis=1).tolist() == [0, 1]
