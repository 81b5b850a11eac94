"""The page of a run in a real browser: it shows the values of the files, with pointer or keys, and on any screen."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.browser import Browser, opened_browser
from tests.support.captures import layers_of, record, write_exr
from tests.support.forward import step_truth
from tests.support.run_cadtof import cadtof

HEIGHT, WIDTH = 24, 32

HOSTILE = "<img src=x onerror=alert(1)>\"'&lt;\u202e$title"

ESCAPED = HOSTILE.replace("\u202e", "\\u202e")
"""How the name is shown: the character that changes the direction of writing is escaped."""

FRAMES = (HOSTILE, "frame_1", "frame_2", "frame_3")
"""Names of the four frames; the third frame is broken."""

Layers = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Shown:
    """A page in a browser, and the layers of its frames, in the order of the viewer."""

    page: Path
    browser: Browser
    frames: tuple[Layers, ...]

    def loss(self, layer: str) -> float:
        """Return the largest rounding error of a layer of the first frame: half of its step."""
        values = self.frames[0][layer]
        return float(np.nanmax(values) - np.nanmin(values)) / 65533 / 2


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with opened_browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[Layers, ...]]:
    """A run of four frames, one with a hostile name, one broken, and its page with truth."""
    folder = tmp_path_factory.mktemp("run")
    capture = record(folder / "capture", frames=4)
    capture.files[0].rename(capture.folder / f"{HOSTILE}.tif")
    capture.files[2].write_bytes(b"II*\0</script><script>alert(2)</script>")
    write_exr(folder / "truth.exr", {"direct.depth": step_truth().astype(np.float32)})
    out = folder / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q").status == 1
    done = cadtof("report", out, "-o", folder / "page.html", "--truth", folder / "truth.exr")
    assert (done.status, done.out) == (0, f"{folder / 'page.html'}\n")
    names = [name for name in FRAMES if name != "frame_2"]
    return folder / "page.html", tuple(layers_of(out / f"{name}.tif") for name in names)


@pytest.fixture
def shown(browser: Browser, written: tuple[Path, tuple[Layers, ...]]) -> Shown:
    """The page, freshly opened."""
    page, frames = written
    # what the browser said in tests before this one
    browser.complaints()
    browser.open(page)
    return Shown(page, browser, frames)


def _pixel_on_page(browser: Browser) -> dict[str, float | str]:
    """Return what the page says of a pixel, by the title of each row.

    The first phasor is left out, because no file holds it.
    """
    rows = browser.run(
        "return [...document.querySelectorAll('#readout tbody tr')].map(row => [...row.cells].map(one => one.textContent))"
    )
    values = {name: text if name == "status" else _number(text) for name, text in rows if "first phasor" not in name}
    return {"pixel": browser.find("#readout-title").text, **values}


def _number(text: str) -> float:
    """Return the value of a text on the page, in m or V, or without a unit."""
    if text == "no answer":
        return np.nan
    digits, _, unit = text.replace("−", "-").partition(" ")
    return float(digits) * (1e-3 if unit in {"mm", "mV"} else 1.0)


def _pixel_in_files(shown: Shown, frame: int, x: int, y: int) -> dict[str, Any]:
    """Return what the files hold of a pixel, with the tolerances of the page.

    A tolerance has two parts: the rounding error of the layer, and that of the number on the page. The number has five
    digits, at most four of them behind the point, in m, V, mm or mV.
    """
    layers, truth = dict(shown.frames[frame]), step_truth()
    status = {8: "one path", 16: "two paths"}[int(layers.pop("status")[y, x])]
    values = {name: float(plane[y, x]) for name, plane in layers.items()} | {"truth": truth[y, x]}
    values["error"] = values["direct.depth"] - values["truth"]
    losses = {name: shown.loss(name) for name in layers} | {"truth": 1e-6, "error": shown.loss("direct.depth") + 1e-6}
    digits = {name: 5e-5 * max(abs(value), 1.0 if abs(value) > 0.09 else 1e-3) for name, value in values.items()}
    held = {
        name: pytest.approx(value, rel=0, abs=1.5 * losses[name] + digits[name], nan_ok=True)
        for name, value in values.items()
    }
    return {"pixel": f"Pixel {x}, {y}", **held, "status": status}


def _show_layer(browser: Browser, name: str) -> None:
    browser.run(
        "const one = document.querySelector('#layer'); one.value = arguments[0]; one.dispatchEvent(new Event('change'))",
        name,
    )
    browser.settle()


def _place(x: int, y: int) -> tuple[float, float]:
    return (x + 0.5) / WIDTH, (y + 0.5) / HEIGHT


def _canvas(browser: Browser, css: str = "#map") -> NDArray[np.uint8]:
    """Return the colours of a canvas, RGB, at the middle of each pixel of the map."""
    browser.settle()
    script = """
        const [css, columns, rows] = arguments, canvas = document.querySelector(css), found = [];
        const whole = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
        for (let y = 0; y < rows; y += 1) for (let x = 0; x < columns; x += 1) {
            const across = Math.floor((x + .5) / columns * canvas.width);
            const place = Math.floor((y + .5) / rows * canvas.height) * canvas.width + across;
            found.push(...whole.slice(4 * place, 4 * place + 3));
        }
        return found;
    """
    return np.array(browser.run(script, css, WIDTH, HEIGHT), np.uint8).reshape(HEIGHT, WIDTH, 3)


def test_the_page_opens_without_complaints_and_runs_no_markup_in_a_name(shown: Shown) -> None:
    browser = shown.browser
    assert browser.complaints() == []
    assert not browser.all("img[src=x]")
    assert (
        browser.run("return document.querySelectorAll('script').length") == 3 + 1 + 1 + 1
    )  # frames, truth, run, its own
    assert browser.find("#frame-name").text == f"{ESCAPED} (1 of 3)"
    assert "frame_2.tif" in browser.find("#failures").text
    assert (
        browser.run(
            "return performance.getEntriesByType('resource').filter(one => !one.name.startsWith('data:')).length"
        )
        == 0
    )


def test_scripts_and_markup_from_elsewhere_are_refused(shown: Shown) -> None:
    browser = shown.browser
    added = "const made = document.createElement('script'); made.append('window.ran = 1'); document.body.append(made)"
    browser.run(f"try {{ {added} }} catch {{}}")
    assert browser.run("return window.ran") is None
    refused = "try { document.body.innerHTML = '<p>'; return 'taken' } catch (error) { return error.name }"
    assert browser.run(refused) == "TypeError"
    refused = "return fetch('https://example.org/').then(() => 'sent', () => 'refused')"
    assert browser.run(refused) == "refused"
    assert any("Content Security Policy" in one for one in browser.complaints())


def test_pointing_at_a_pixel_shows_the_values_of_the_file(shown: Shown) -> None:
    for x, y in ((0, 0), (31, 23), (3, 20), (20, 5)):
        shown.browser.point("#map", _place(x, y))
        assert _pixel_on_page(shown.browser) == _pixel_in_files(shown, 0, x, y)


def test_keys_move_the_pixel_and_change_the_frame(shown: Shown) -> None:
    shown.browser.point("#map", _place(10, 10))
    shown.browser.press("#map", "ARROW_RIGHT", "ARROW_RIGHT", "ARROW_UP")
    assert _pixel_on_page(shown.browser) == _pixel_in_files(shown, 0, 12, 9)
    assert "Column 12, row 9: direct.depth" in _said(shown.browser)
    shown.browser.press("#map", "ENTER", "ARROW_DOWN", "ARROW_DOWN", "ENTER", "ARROW_UP", "ARROW_UP")
    assert shown.browser.find("#profile-title").text == "Profile from pixel 12, 9 to 12, 11"
    shown.browser.press("#map", "PAGE_DOWN")
    shown.browser.wait("return document.querySelector('#frame-name').textContent.includes('frame_1')")
    assert _said(shown.browser) == "frame_1  (2 of 3)"
    assert shown.browser.find("#map").get_attribute("aria-label") == "Map of direct.depth, frame_1, 32 × 24 pixels"
    shown.browser.press("#map", "r")
    assert _said(shown.browser) == "Profile from pixel 0, 9 to 31, 9"
    assert _pixel_on_page(shown.browser) == _pixel_in_files(shown, 1, 12, 9)
    shown.browser.press("#strip li:first-child button", "END")
    shown.browser.driver.switch_to.active_element.send_keys("\n")
    shown.browser.wait("return document.querySelector('#frame-name').textContent.includes('frame_3')")
    assert _pixel_on_page(shown.browser) == _pixel_in_files(shown, 2, 12, 9)


def _said(browser: Browser) -> str:
    """Return what a screen reader says of the last change."""
    return str(browser.find("#said").get_attribute("textContent"))


def test_thumbnails_are_one_stop_of_the_tab_key_and_the_chosen_one_is_seen(shown: Shown) -> None:
    """A run has hundreds of thumbnails, and in the colours of a system of high contrast all their borders would be the same."""
    browser = shown.browser
    browser.click("#next")
    browser.wait("return document.querySelector('#frame-name').textContent.includes('frame_1')")
    stops = "return [...document.querySelectorAll('#strip button')].map(one => one.tabIndex)"
    assert browser.run(stops) == [-1, 0, -1]
    browser.tell("Emulation.setEmulatedMedia", features=[{"name": "forced-colors", "value": "active"}])
    border = "return [...document.querySelectorAll('#strip button')].map(one => getComputedStyle(one).borderTopColor)"
    others, chosen, _ = browser.run(border)
    assert others != chosen


def test_the_button_of_the_next_frame_keeps_the_focus_at_the_last_frame(shown: Shown) -> None:
    browser = shown.browser
    browser.press("#next", "ENTER")
    browser.wait("return document.querySelector('#frame-name').textContent.includes('frame_1')")
    browser.press("#next", "ENTER")
    browser.wait("return document.querySelector('#next').ariaDisabled === 'true'")
    assert browser.run("return document.activeElement.id") == "next"
    browser.press("#next", "ENTER")
    assert browser.find("#frame-name").text == "frame_3 (3 of 3)"


def test_a_dragged_line_is_a_profile_of_the_file(shown: Shown) -> None:
    browser = shown.browser
    browser.click("#profile-table summary")
    browser.point("#map", _place(2, 4), _place(15, 8), _place(29, 13), drag=True)
    assert browser.find("#profile-title").text == "Profile from pixel 2, 4 to 29, 13"
    table = browser.find("#profile-table table").get_attribute("innerText").split("\n")
    assert table[0].split("\t") == ["column", "row", "direct.depth, m", "sigma, m", "first phasor, m", "truth, m"]
    rows = np.array([line.split("\t") for line in table[1:] if line], float)
    x, y = rows[:, 0].astype(int), rows[:, 1].astype(int)
    np.testing.assert_array_equal(x, np.arange(2, 30))
    assert np.abs(y - (4 + (x - 2) / 3)).max() <= 0.5
    for column, name in ((2, "direct.depth"), (3, "direct.sigma")):
        np.testing.assert_allclose(rows[:, column], shown.frames[0][name][y, x], rtol=5e-6, atol=1.5 * shown.loss(name))
    np.testing.assert_allclose(rows[:, 5], step_truth()[y, x], rtol=1e-5)
    assert len(browser.all("#profile .band")) >= 1
    browser.press("#map", "c")
    assert browser.find("#profile-title").text == "Profile from pixel 29, 0 to 29, 23"


def test_layers_can_be_switched_and_compared_layers_share_their_colours(shown: Shown) -> None:
    browser = shown.browser
    names = [option.text for option in browser.all("#layer option")]
    assert names == [
        *(name for name in shown.frames[0] if name != "status"),
        "first phasor",
        "truth",
        "error",
        "error of first phasor",
    ]
    pictures, ends = {}, {}
    for name in names:
        _show_layer(browser, name)
        pictures[name] = _canvas(browser)
        ends[name] = browser.find("#low-text").text, browser.find("#high-text").text
    assert ends["direct.depth"] == ends["first phasor"] == ends["truth"] != ends["confidence"]
    assert ends["error"] == ends["error of first phasor"]
    no_answer = (pictures["mpi.depth"] == 0xB2).all(axis=2)
    wanted = np.isnan(shown.frames[0]["mpi.depth"])
    away = np.ones((HEIGHT, WIDTH), bool)
    away[10:15] = False  # the marks of the pixel and the profile lie in these rows
    assert no_answer[away & wanted].all()
    assert not no_answer[away & ~wanted].any()


def test_the_slider_shows_the_first_phasor_on_the_left(shown: Shown) -> None:
    browser = shown.browser
    resolved = _canvas(browser)
    _show_layer(browser, "first phasor")
    phasor = _canvas(browser)
    assert (resolved[:10, 16:] != phasor[:10, 16:]).any()
    _show_layer(browser, "direct.depth")
    browser.click("#compare")
    browser.press("#split", *["ARROW_RIGHT"] * 25)
    both = _canvas(browser)
    np.testing.assert_array_equal(both[:10, :23], phasor[:10, :23])
    np.testing.assert_array_equal(both[:10, 25:], resolved[:10, 25:])
    marks = {"direct.depth": "resolved", "error": "resolved", "truth": "truth", "mpi.depth": "mpi.depth"}
    for layer, mark in marks.items():
        _show_layer(browser, layer)
        assert browser.find("#compare-marks").text.splitlines() == ["first phasor", mark]


def test_the_ends_of_the_colours_can_be_dragged_and_typed(shown: Shown) -> None:
    browser = shown.browser
    before = _canvas(browser)
    ends = "return ['low', 'high'].map(end => Number(document.querySelector('#scale-' + end).ariaValueNow))"
    low, high = browser.run(ends)
    layers = [frame["direct.depth"] for frame in shown.frames]
    assert 0.7 < low <= min(np.quantile(one, 0.01) for one in layers) + 1e-4
    assert 2.5 > high >= max(np.quantile(one, 0.99) for one in layers) - 1e-4  # the first phasor is farther
    boxes = "const [box, one] = ['scale', 'scale-high'].map(id => document.getElementById(id).getBoundingClientRect());"
    place = browser.run(f"{boxes} return (one.left + one.width / 2 - box.left) / box.width")
    browser.point("#scale", (place, 0.5), (place - 0.1, 0.5), (place - 0.3, 0.5), drag=True)
    moved_low, moved_high = browser.run(ends)
    assert moved_low == low
    assert moved_high < high
    assert (_canvas(browser) != before).any()
    browser.press("#scale-low", "ARROW_RIGHT")
    assert browser.run(ends)[0] > low
    browser.click("#scale-fit")
    assert browser.run(ends) == pytest.approx(np.quantile(layers[0], (0.005, 0.995)), abs=2e-3)
    browser.click("#scale-reset")
    assert browser.run(ends) == [low, high]
    np.testing.assert_array_equal(_canvas(browser), before)


def test_colours_of_errors_suit_all_frames_of_the_run(browser: Browser, tmp_path: Path) -> None:
    """The first frame is 1 mm off, the second frame up to 1 m: its errors can be told apart, too."""
    maps, truth = tmp_path / "maps", np.full((HEIGHT, WIDTH), 2.0, np.float32)
    maps.mkdir()
    far = truth + np.linspace(0.0, 1.0, WIDTH, dtype=np.float32)
    for name, depth in (("a", truth + np.float32(1e-3)), ("b", far)):
        write_exr(maps / f"{name}.exr", {"direct.depth": depth, "status": np.full(depth.shape, 8, np.uint32)})
    write_exr(tmp_path / "truth.exr", {"direct.depth": truth})
    page = tmp_path / "page.html"
    assert cadtof("report", maps, "-o", page, "--truth", tmp_path / "truth.exr").status == 0
    browser.open(page)
    _show_layer(browser, "error")
    assert _number(browser.find("#high-text").text) == pytest.approx(1.0, abs=0.04)
    browser.click("#next")
    browser.wait("return document.querySelector('#frame-name').textContent.startsWith('b')")
    browser.click("#scale-fit")
    browser.settle()
    assert _number(browser.find("#high-text").text) == pytest.approx(np.quantile(far - truth, 0.98), abs=0.04)


def test_a_line_that_was_begun_stays_at_its_pixel_in_a_frame_of_other_size(browser: Browser, tmp_path: Path) -> None:
    """Two frames of a run may have different sizes: the begin of a line then lies within both."""
    for name, shape in (("a", (HEIGHT, WIDTH)), ("b", (8, 8))):
        write_exr(tmp_path / f"{name}.exr", {"direct.depth": np.full(shape, 2.0, np.float32)})
    assert cadtof("report", tmp_path, "-o", tmp_path / "page.html").status == 0
    browser.open(tmp_path / "page.html")
    browser.point("#map", _place(WIDTH - 1, HEIGHT - 1))
    browser.press("#map", "ENTER", "PAGE_DOWN")
    browser.wait("return document.querySelector('#frame-name').textContent.startsWith('b')")
    browser.press("#map", "ARROW_LEFT")
    assert browser.find("#profile-title").text == "Profile from pixel 7, 7 to 6, 7"


def test_a_page_of_a_region_says_that_its_points_need_the_principal_point(browser: Browser, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=1)
    out, page = tmp_path / "out", tmp_path / "page.html"
    settings = capture.folder / "capture.toml"
    kept = [line for line in settings.read_text().splitlines() if not line.startswith("principal_point_px")]
    settings.write_text("\n".join(kept))
    assert cadtof("resolve", capture.folder, "-o", out, "--roi", "4,4,20,20", "-j", 1, "-q").status == 0
    assert cadtof("report", out, "-o", page, "--focal-length-px", 100).status == 0
    browser.open(page)
    assert "--principal-point-px" in browser.find("#cloud-note").text


def test_status_bits_lie_over_the_pixels_that_have_them(shown: Shown) -> None:
    browser = shown.browser
    status = shown.frames[0]["status"].astype(int)
    text = browser.find("#overlays").text
    for bit, name in ((8, "one path"), (16, "two paths")):
        assert name in text
        assert f"{100 * np.mean((status & bit) != 0):.1f} %" in text
    for layer in ("mpi.depth", "direct.depth"):
        _show_layer(browser, layer)
        none = f"no answer\n{100 * np.mean(np.isnan(shown.frames[0][layer])):.1f} %"
        assert browser.find("#overlays").text.endswith(none)
    before = _canvas(browser)
    browser.click("#overlays input[value='16']")
    changed = (_canvas(browser) != before).any(axis=2)
    rows = [*range(10), *range(15, HEIGHT)]
    np.testing.assert_array_equal(changed[rows], ((status & 16) != 0)[rows])


def test_the_points_turn_and_come_back(shown: Shown) -> None:
    browser = shown.browser
    start = browser.picture("#cloud")
    assert len(np.unique(start.reshape(-1, 3), axis=0)) > 20
    browser.point("#cloud", (0.5, 0.5), (0.6, 0.55), (0.7, 0.6), drag=True)
    turned = browser.picture("#cloud")
    assert (turned != start).any(axis=2).mean() > 0.01
    browser.press("#cloud", "ARROW_LEFT", "+")
    assert (browser.picture("#cloud") != turned).any()
    # with Shift, arrows move the points without turning them, by a twentieth of the width each
    moved = start.shape[1] // 10
    browser.press("#cloud", "0", "\ue008\ue014", "\ue008\ue014")
    browser.run("document.activeElement.blur()")
    same = browser.picture("#cloud")[8:-8, 8 + moved : -8] == start[8:-8, 8 : -8 - moved]
    assert same.all(axis=2).mean() > 0.95
    assert (browser.picture("#cloud") != start).any(axis=2).mean() > 0.1
    browser.press("#cloud", "0")
    browser.run("document.activeElement.blur()")
    np.testing.assert_array_equal(browser.picture("#cloud"), start)


@pytest.mark.parametrize(("width", "dark"), [(320, False), (360, True), (768, False), (2560, True)])
def test_the_page_fits_any_screen_in_light_and_dark(shown: Shown, width: int, dark: bool) -> None:
    browser = shown.browser
    browser.look(width=width, dark=dark)
    browser.settle()
    assert browser.run("return document.documentElement.scrollWidth") <= width
    cut = "return [...document.querySelectorAll('.settings .wide')].filter(one => one.scrollWidth > one.clientWidth).length"
    assert browser.run(cut) == 0
    background = browser.run("return getComputedStyle(document.body).backgroundColor")
    lightness = sum(map(int, background.strip("rgb()").split(","))) / 3
    assert lightness < 60 if dark else lightness > 200
    browser.point("#map", _place(20, 5))
    assert _pixel_on_page(shown.browser) == _pixel_in_files(shown, 0, 20, 5)
    assert browser.picture("#map").shape[1] <= width


def test_the_page_prints_in_light_colours_with_its_tables(shown: Shown) -> None:
    browser = shown.browser
    browser.look(dark=True, media="print")
    assert browser.run("return getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert not browser.find("#split").is_displayed()
    assert not browser.find("nav").is_displayed()
    assert not browser.find("#compare-label").is_displayed()
    # without these, nothing would say what the map shows, and where in the bar its ends lie
    for one in ("#layer", "#scale-low", "#scale-high"):
        assert browser.find(one).is_displayed()
    browser.look(dark=True)
    printed = browser.printed()
    assert printed.startswith(b"%PDF")
    assert printed.count(b"/Type /Page\n") >= 2


def test_tables_and_thumbnails_need_no_scripts(shown: Shown) -> None:
    browser = shown.browser
    browser.tell("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.driver.refresh()
        text = browser.find("main").text
        assert not browser.find("#viewer").is_displayed()
        assert not browser.find("#skip").is_displayed()
        assert "need scripts" in text
        assert "modulation.periods_ns" in text
        assert "largest rounding" in text
        assert "damaged or truncated TIFF" in browser.find("#failures").text
        assert len(browser.all("#strip img")) == 3
    finally:
        browser.tell("Emulation.setScriptExecutionDisabled", value=False)


def test_pixels_of_a_frame_that_is_thinned_out_are_those_of_the_file(
    browser: Browser, written: tuple[Path, tuple[Layers, ...]], tmp_path: Path
) -> None:
    """A page that is too small for all pixels of its frames holds pixels of the file, and says which."""
    _, frames = written
    noise = np.random.default_rng(3).uniform(0.9, 1.1, (480, 640)).astype(np.float32)
    layers: dict[str, NDArray[np.generic]] = {
        name: np.tile(plane, (20, 20)) * (1 if name == "status" else noise) for name, plane in frames[1].items()
    }
    for name in ("a", "b"):
        write_exr(tmp_path / f"{name}.exr", layers)
    done = cadtof(
        "report",
        tmp_path,
        "-o",
        tmp_path / "page.html",
        "--max-size-mb",
        1,
        "--full-frames",
        0,
        "--focal-length-px",
        400,
    )
    assert done.status == 0
    assert (tmp_path / "page.html").stat().st_size < 1_000_000
    browser.open(tmp_path / "page.html")
    note = browser.find("#sampling").text
    assert note.endswith("of 640 × 480 pixels.")
    browser.point("#map", (0.3, 0.7))
    x, y = map(int, browser.find("#readout-title").text.removeprefix("Pixel ").split(", "))
    assert _pixel_on_page(browser)["direct.depth"] == pytest.approx(layers["direct.depth"][y, x], abs=1.5e-4)
    assert abs(x / 640 - 0.3) < 0.02
    assert abs(y / 480 - 0.7) < 0.02
    assert json.loads(browser.run("return document.querySelector('#run').textContent"))["truth"] == []
