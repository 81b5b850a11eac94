"""`cadtof report` without a browser: what is written, what is refused, and that nothing in a run becomes markup."""

import json
import re
import shutil
import tomllib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.resolver.status import StatusBit, bit_words
from tests.support.captures import layers_of, record, write_exr
from tests.support.forward import step_truth
from tests.support.run_cadtof import ROOT, cadtof

NO_RECORD = "no run.json beside the maps, so the first phasor is left out\n"

ATTACK = "</script><script>alert(1)</script>"


class _Page(HTMLParser):
    """The scripts, the policy and the text of a page, as Python's HTML parser finds them."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.scripts: list[dict[str, str | None]] = []
        self.policy = ""
        self.text = ""
        self._within: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self._within.append(tag)
        if tag == "script":
            self.scripts.append(values)
        if values.get("http-equiv") == "Content-Security-Policy":
            self.policy = str(values["content"])
        assert not any(name.startswith("on") for name in values), values
        assert tag not in {"iframe", "object", "embed", "link", "base", "form"}
        for name in ("src", "href"):
            assert values.get(name) is None or re.match("#|data:image/png;base64,", str(values[name])), values

    def handle_endtag(self, tag: str) -> None:
        while self._within and self._within.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self._within and self._within[-1] not in {"script", "style"}:
            self.text += data


def _run(folder: Path, *, frames: int = 2) -> Path:
    capture = record(folder / "capture", frames=frames)
    assert cadtof("resolve", capture.folder, "-o", folder / "out", "-j", 1, "-q").status == 0
    return folder / "out"


def _page(*arguments: object, message: str = "") -> _Page:
    out = Path(str(arguments[0])).parent / "page.html"
    done = cadtof("report", *arguments, "-o", out, "--overwrite")
    assert (done.status, done.out) == (0, f"{out}\n")
    assert message in done.err
    page = _Page()
    page.feed(out.read_text(encoding="utf-8"))
    return page


def test_a_page_says_what_the_run_says(tmp_path: Path) -> None:
    out = _run(tmp_path)
    write_exr(tmp_path / "truth.exr", {"direct.depth": step_truth().astype(np.float32)})
    page = _page(out, "--truth", tmp_path / "truth.exr")
    run = json.loads((out / "run.json").read_text())
    for words in (
        "Every frame has its maps.",
        "false_alarm",
        run["started"],
        "modulation.periods_ns",
        "40.0, 20.0",
        "direct path",
        "so it has the roundings of both",
    ):
        assert words in page.text
    evaluated = json.loads(cadtof("evaluate", out, "--truth", tmp_path / "truth.exr", "--json").out)
    for errors in (evaluated["direct"], evaluated["first_phasor"]):
        assert (
            f"{errors['median_cm']:.2f}{errors['p90_cm']:.2f}{errors['rmse_cm']:.2f}{errors['bias_cm']:.2f}"
            in page.text
        )


def test_frames_of_several_captures_are_told_apart_and_their_settings_folded(tmp_path: Path) -> None:
    names = ("friday", "monday", "tuesday")
    for name in names:
        record(tmp_path / "week" / name)
    assert cadtof("resolve", "-r", tmp_path / "week", "-o", tmp_path / "out", "-j", 1, "-q").status == 0
    _page(tmp_path / "out")
    source = (tmp_path / "page.html").read_text(encoding="utf-8")
    strip, settings = (source.partition(f'id="{part}"')[2].partition("</section>")[0] for part in ("strip", "settings"))
    strip = strip.partition("</ol>")[0]
    assert re.findall("<bdi>(.*?)</bdi>", strip) == [line for name in names for line in (name, "frame_0")]
    assert re.findall("<summary><h3[^>]*>Capture (\\d): ", settings) == ["1", "2", "3"]
    # a setting that nobody has set has no line
    assert "modulation.periods_ns" in settings
    assert "layout.pattern" not in settings


def test_the_colours_of_a_layer_suit_the_values_of_all_maps(tmp_path: Path) -> None:
    out = _run(tmp_path)
    _page(out)
    (limits,) = re.findall(r'"limits":({.*?})', (tmp_path / "page.html").read_text(encoding="utf-8"))
    lowest, highest = json.loads(limits)["direct.depth"][2:]
    depths = np.stack([layers_of(file)["direct.depth"] for file in sorted(out.glob("*.tif"))])
    assert (lowest, highest) == (pytest.approx(np.nanmin(depths), rel=1e-6), pytest.approx(np.nanmax(depths), rel=1e-6))
    assert "status" not in json.loads(limits)


def test_status_bits_are_explained_on_the_page(tmp_path: Path) -> None:
    explanations = _page(_run(tmp_path)).text.partition("Status bits: what became of a pixel")[2]
    for bit in StatusBit:
        assert f"{bit_words(bit)}{bit.meaning.replace('`', '')}" in explanations


def test_the_policy_lets_its_own_script_run_and_nothing_else(tmp_path: Path) -> None:
    page = _page(_run(tmp_path))
    rules = dict(rule.split(" ", 1) for rule in page.policy.split("; "))
    assert rules["default-src"] == "'none'"
    assert re.fullmatch(r"'sha256-[\w+/=]{44}'", rules["script-src"])
    assert re.fullmatch(r"'sha256-[\w+/=]{44}'", rules["style-src"])
    assert rules["img-src"] == "data:"
    assert (rules["base-uri"], rules["form-action"], rules["trusted-types"]) == ("'none'", "'none'", "'none'")
    kinds = [script.get("type") for script in page.scripts]
    assert kinds == ["application/json", "text/plain", "text/plain", "module"]


def test_nothing_in_the_record_becomes_markup(tmp_path: Path) -> None:
    """Names, reasons, settings and what others wrote into run.json stand in the page as text."""
    out = _run(tmp_path)
    clean = _page(out)
    run = json.loads((out / "run.json").read_text())
    run["kernel"] = run["started"] = run["calibration"] = ATTACK
    run["calibration"] = {"folder": ATTACK, ATTACK: {ATTACK: [ATTACK]}}
    run["arguments"] |= {"solver": f'"{ATTACK}', ATTACK: ATTACK}
    run["captures"][0]["root"] = run["captures"][0]["metadata"]["modulation"]["waveform"] = ATTACK
    run["captures"][0]["origins"]["modulation.waveform"] = f"<!-- {ATTACK}"
    (out / "run.json").write_text(json.dumps(run))
    failed = {
        "source": f"a/{ATTACK}.tif",
        "output": None,
        "status": "failed",
        "reason": f"]]>{ATTACK}\u2028\ud800",
        "seconds": 0.1,
    }
    with (out / "frames.jsonl").open("a") as lines:
        lines.write(json.dumps(failed) + "\n")
    page = _page(out)
    assert page.scripts == clean.scripts
    assert page.text.count(ATTACK) >= 12
    assert f"]]>{ATTACK}\\u2028\\ud800" in page.text


def test_failures_stand_on_the_page_with_their_reasons(tmp_path: Path) -> None:
    """A frame that failed, a map that was damaged afterwards, a map that is gone, and a map that no record names."""
    capture = record(tmp_path / "capture", frames=5)
    capture.files[1].write_bytes(b"no frame")
    out = tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q").status == 1
    (out / "frame_2.tif").write_bytes((out / "frame_2.tif").read_bytes()[:900])
    (out / "frame_3.tif").rename(out / "elsewhere.tif")
    page = _page(out)
    assert "3 failed, 0 skipped" in page.text
    assert "found a file of another kind (first bytes" in page.text
    assert "its maps are gone" in page.text
    assert "1 of the maps cannot be read" in page.text
    # the labels of thumbnails have the same form for all frames, with and without maps
    html = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert all(f"<bdi>frame_{number}</bdi>" in html for number in (0, 1, 2, 3, 4))
    assert sum(script.get("type") == "text/plain" for script in page.scripts) == 3


def test_a_run_without_a_single_map_has_a_page(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=1)
    capture.files[0].write_bytes(b"no frame")
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "-q").status == 1
    page = _page(tmp_path / "out")
    assert "1 failed, 0 skipped" in page.text
    assert "The page holds no maps." in page.text


def test_maps_alone_and_a_run_that_was_moved(tmp_path: Path) -> None:
    """Maps without a record are shown, too. In a folder that was moved, maps are found by their places in it."""
    out = _run(tmp_path)
    shutil.copytree(out, tmp_path / "moved" / "there")
    assert "2resolved2failed0" in _page(tmp_path / "moved" / "there").text.replace("\n", "")
    (tmp_path / "bare").mkdir()
    shutil.copy(out / "frame_0.tif", tmp_path / "bare" / "one.tif")
    bare = _page(tmp_path / "bare", message="no run.json beside the maps")
    assert "There is no run.json beside the maps" in bare.text
    assert "frames1" in bare.text.replace("\n", "")
    single = _page(out / "frame_1.tif")
    assert "frames1" in single.text.replace("\n", "")
    assert "Of 1 frame, the page holds all pixels of 1." in single.text


def test_maps_of_captures_are_not_called_gone_without_a_record(tmp_path: Path) -> None:
    """Without `run.json`, nothing says how the run called its folder; `frames.jsonl` names the maps from there on."""
    for name in ("friday", "monday"):
        record(tmp_path / "week" / name, frames=2)
    out = tmp_path / "out"
    assert cadtof("resolve", "-r", tmp_path / "week", "-o", out, "-j", 1, "-q").status == 0
    (out / "run.json").unlink()
    (out / "monday" / "frame_1.tif").unlink()
    page = _page(out, message="no run.json beside the maps")
    assert "frames4resolved4failed1" in page.text.replace("\n", "")
    truth = write_exr(tmp_path / "truth.exr", {"direct.depth": step_truth().astype("float32")})
    told = f"{out}: 1 frame of the run without maps, not compared: see frames.jsonl\n"
    for arguments in (("--truth", truth), ("--over-time", tmp_path / "scatter.exr")):
        assert cadtof("evaluate", out, *arguments).err.replace(NO_RECORD, "") == told


def test_impossible_pages_are_refused(tmp_path: Path) -> None:
    out = _run(tmp_path, frames=1)
    write_exr(tmp_path / "small.exr", {"direct.depth": np.ones((3, 4), np.float32)})
    (tmp_path / "empty").mkdir()
    (tmp_path / "there.html").write_text("mine")
    for arguments, message in (
        ((out, "-o", tmp_path / "a.pdf"), "found the suffix '.pdf', expected .html or .htm"),
        ((out, "-o", tmp_path / "there.html"), "already exists; add --overwrite to replace it"),
        ((out, "-o", tmp_path / "gone" / "a.html"), "cannot be written: No such file or directory"),
        ((tmp_path / "empty", "-o", tmp_path / "a.html"), "found no maps"),
        ((tmp_path / "nowhere", "-o", tmp_path / "a.html"), "no such file or folder"),
        ((out, "-o", tmp_path / "a.html", "--truth", tmp_path / "small.exr"), "found 32 × 24 pixels, expected 4 × 3"),
        ((out, "-o", tmp_path / "a.html", "--max-size-mb", "0.5"), "--max-size-mb: found 0.5, expected 1 to 1000000"),
        ((out, "-o", tmp_path / "a.html", "--max-size-mb", "inf"), "--max-size-mb: found inf, expected 1 to 1000000"),
        ((out, "-o", tmp_path / "a.html", "--full-frames", "-1"), "--full-frames: found -1, expected 0 or more"),
        ((out, "-o", tmp_path / "a.html", "--principal-point-px", "1"), "found 1, expected 2 values (X,Y)"),
    ):
        done = cadtof("report", *arguments)
        assert (done.status, done.out) == (2, "")
        assert message in done.err
    assert (tmp_path / "there.html").read_text() == "mine"
    assert not list(tmp_path.glob("a.*"))


def test_the_same_run_gives_the_same_page(tmp_path: Path) -> None:
    out = _run(tmp_path)
    _page(out)
    first = (tmp_path / "page.html").read_bytes()
    _page(out)
    assert (tmp_path / "page.html").read_bytes() == first


def test_the_parts_of_the_page_are_in_the_wheel() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    patterns = project["tool"]["setuptools"]["package-data"]["cadtof_cli.report"]
    folder = ROOT / "cadtof_cli" / "report"
    assert {path for pattern in patterns for path in folder.glob(pattern)} == set((folder / "page").iterdir())
    assert "graft cadtof_cli" in (ROOT / "MANIFEST.in").read_text()


@pytest.mark.parametrize("limit", [1, 3])
def test_a_page_stays_below_the_size_that_was_asked_for(limit: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for number in range(12):
        layers: dict[str, NDArray[np.generic]] = {
            f"{path}.{name}": rng.uniform(1, 2, (120, 160)).astype(np.float32)
            for path in ("direct", "mpi")
            for name in ("depth", "sigma")
        }
        write_exr(tmp_path / f"{number:02}.exr", layers)
    out = tmp_path / "page.html"
    assert cadtof("report", tmp_path, "-o", out, "--max-size-mb", limit).status == 0
    assert 0.3e6 * limit < out.stat().st_size < 1e6 * limit
    assert "every" in out.read_text(encoding="utf-8")


def test_a_page_of_many_frames_stays_below_its_limit(tmp_path: Path) -> None:
    """It shows only as many frames as fit; totals are of all frames."""
    out = _run(tmp_path, frames=200)
    page = _page(out, "--max-size-mb", 1)
    assert (tmp_path / "page.html").stat().st_size < 1_000_000
    found = re.search(r"The page shows (\d+) of 200 frames with maps", page.text)
    assert found is not None
    assert 50 < int(found[1]) < 200
    assert f"{found[1]} of 200 frames" in page.text
    assert len([one for one in page.scripts if str(one.get("id")).startswith("frame-")]) == int(found[1])
    assert "resolved200" in page.text
