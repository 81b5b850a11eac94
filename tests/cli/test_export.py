"""`cadtof export`, opened again by trimesh, plyfile, pypcd4, OpenCV, Pillow and numpy."""

import csv
import shutil
import tracemalloc
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.captures import layers_of, record, write_exr
from tests.support.needed import needed_module
from tests.support.run_cadtof import cadtof

FIELDS = ("x", "y", "z", "amplitude", "sigma", "status")
Cloud = dict[str, NDArray[Any]]


def _ply(path: Path, fields: tuple[str, ...] = FIELDS) -> Cloud:
    vertices = needed_module("plyfile").PlyData.read(str(path))["vertex"].data
    assert vertices.dtype.names == fields
    return {name: np.array(vertices[name]) for name in fields}


def _pcd(path: Path, fields: tuple[str, ...] = FIELDS) -> Cloud:
    cloud = needed_module("pypcd4").PointCloud.from_path(path)
    assert tuple(cloud.fields) == fields
    return {name: np.array(cloud.pc_data[name]) for name in fields}


READERS = {".ply": _ply, ".pcd": _pcd}


def _exported(out: Path, *arguments: object) -> Path:
    done = cadtof("export", *arguments, "-o", out)
    assert (done.status, done.out, done.err) == (0, f"{out}\n", "")
    return out


def _maps(folder: Path, *options: object, frames: int = 1) -> Path:
    capture = record(folder / "capture", frames=frames)
    assert cadtof("resolve", capture.folder, "-o", folder / "out", "-j", 1, "-q", *options).status == 0
    return folder / "out"


@pytest.mark.parametrize("depth", ["range", "z"])
def test_points_of_a_part_lie_where_those_of_the_whole_lie(depth: str, tmp_path: Path) -> None:
    """Points from maps of a --roi lie where those from whole maps lie: the optical axis is that of the whole frame."""
    options = ("-o", tmp_path / "out", "-j", 1, "-q", "--mpi-model", "discrete", "--depth", depth, "--overwrite")
    capture = record(tmp_path / "capture").folder
    places = []
    for part in ((), ("--roi", "3,2,9,8")):
        assert cadtof("resolve", capture, *options, *part).status == 0
        cloud = _ply(_exported(tmp_path / f"{len(part)}.ply", tmp_path / "out"))
        places.append({tuple(point) for point in np.stack([cloud[name] for name in "xyz"], axis=1).tolist()})
    whole, part_of_it = places
    assert 0 < len(part_of_it) <= 36
    assert part_of_it < whole


def test_points_of_a_part_need_the_principal_point(tmp_path: Path) -> None:
    """Without a principal point, the axis is at the centre of the frame. Maps of a part do not show where that is."""
    capture = record(tmp_path / "capture", form="exr").folder
    options = ("-j", 1, "-q", "--focal-length", 28)
    assert cadtof("resolve", capture, "-o", tmp_path / "out", "--roi", "3,2,9,8", *options).status == 0
    refused = cadtof("export", tmp_path / "out", "-o", tmp_path / "a.ply")
    assert refused.status == 2
    assert (
        "its optics are unknown: give --focal-length-px, and for maps of a --roi also --principal-point-px"
        in refused.err
    )
    _exported(tmp_path / "a.ply", tmp_path / "out", "--principal-point", "12,8")
    _exported(tmp_path / "a.png", tmp_path / "out")


@pytest.mark.parametrize("ending", READERS)
def test_a_wall_keeps_its_distance_and_tilt(ending: str, tmp_path: Path) -> None:
    """A wall 3 m away, tilted by 20° and 10°: a plane that is fitted to the points has the true distance and tilt.

    Another library reads the points.
    """
    wall, tilt = tmp_path / "wall", np.radians([20.0, 10.0])
    scene = ("--scene", "wall", "--distance-m", 3, "--tilt-deg", "20,10", "--seed", 5)
    assert cadtof("simulate", *scene, "-o", wall).status == 0
    assert cadtof("resolve", wall, "-o", tmp_path / "out", "-j", 1, "-q", "--mpi-model", "discrete").status == 0
    cloud = READERS[ending](_exported(tmp_path / f"wall{ending}", tmp_path / "out"))
    truth = layers_of(wall / "truth.exr")["direct.depth"].astype(np.float64)
    depth = layers_of(next((tmp_path / "out").glob("frame_*")))["direct.depth"]
    points = np.stack([cloud[name].astype(np.float64) for name in "xyz"], axis=1)
    assert len(points) == np.isfinite(depth).sum() > 0.99 * truth.size
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), depth[np.isfinite(depth)], rtol=1e-6)
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    normal *= np.sign(normal[2])
    # the true plane, from the ranges of truth: focal length 280 px, the optical axis in the middle
    rows, columns = truth.shape
    y, x = np.mgrid[:rows, :columns]
    rays = np.stack([(x - (columns - 1) / 2) / 280.0, (y - (rows - 1) / 2) / 280.0, np.ones_like(x, float)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    solid = np.linalg.lstsq((rays * truth[..., None]).reshape(-1, 3), np.ones(truth.size), rcond=None)[0]
    expected = solid / np.linalg.norm(solid)
    assert np.degrees(np.arccos(abs(expected @ normal))) < 0.1
    assert 1.0 / np.linalg.norm(solid) == pytest.approx(normal @ middle, abs=0.005)
    assert expected[2] == pytest.approx(np.cos(np.arctan(np.hypot(*np.tan(tilt)))), abs=0.02)
    assert np.median(np.abs((points - middle) @ normal)) < 2.0 * np.median(cloud["sigma"])


def test_a_wall_fitted_by_trimesh_lies_and_leans_within_its_noise(tmp_path: Path) -> None:
    """The wall is 3 m away along the axis, with slopes tan 20° and tan 10°.

    The fit is off by at most five standard errors of a plane through points with this noise.
    """
    trimesh, wall = needed_module("trimesh"), tmp_path / "wall"
    scene = ("--scene", "wall", "--distance-m", 3, "--tilt-deg", "20,10", "--seed", 8)
    assert cadtof("simulate", *scene, "-o", wall).status == 0
    assert cadtof("resolve", wall, "-o", tmp_path / "out", "-j", 1, "-q", "--mpi-model", "discrete").status == 0
    cloud = trimesh.load(_exported(tmp_path / "wall.ply", tmp_path / "out"))
    fields = cloud.metadata["_ply_raw"]["vertex"]["data"]
    assert fields.dtype.names == FIELDS
    assert set(np.unique(fields["status"] & ~np.uint32(32))) <= {8, 16}
    points = np.asarray(cloud.vertices)
    middle, normal = trimesh.points.plane_fit(points)
    normal = normal * np.sign(normal[2])
    noise = np.median(fields["sigma"]) / np.sqrt(len(points))
    assert abs(middle @ normal / normal[2] - 3.0) < 5.0 * noise / normal[2]
    tilts_deg, spread_m = np.degrees(np.arctan(normal[:2] / normal[2])), points.std(axis=0)[:2]
    assert (np.abs(tilts_deg - (20.0, 10.0)) < 5.0 * np.degrees(noise / spread_m)).all()
    # five standard errors are about a tenth of a millimetre, and a thousandth of a degree
    assert 5.0 * noise < 2e-4


@pytest.mark.parametrize("ending", READERS)
def test_points_are_the_pixels_of_the_map(ending: str, tmp_path: Path) -> None:
    """A point is the range along its pixel's ray, with a focal length of 28 px and the axis at column 15, row 10."""
    out = _maps(tmp_path, "--min-confidence", "0.05")
    layers = layers_of(out / "frame_0.tif")
    for layer, path in (("direct.depth", "direct"), ("mpi.depth", "mpi")):
        cloud = READERS[ending](_exported(tmp_path / f"{path}{ending}", out, "--layer", layer))
        known = np.isfinite(layers[layer])
        y, x = np.nonzero(known)
        rays = np.stack([(x - 15.0) / 28.0, (y - 10.0) / 28.0, np.ones(x.size)])
        points = rays / np.linalg.norm(rays, axis=0) * layers[layer][known]
        for name, values in zip("xyz", points, strict=True):
            np.testing.assert_allclose(cloud[name], values, rtol=1e-6, atol=1e-7)
        np.testing.assert_array_equal(cloud["amplitude"], layers[f"{path}.amplitude"][known])
        np.testing.assert_array_equal(cloud["sigma"], layers[f"{path}.sigma"][known])
        np.testing.assert_array_equal(cloud["status"], layers["status"][known])
    assert known.sum() < known.size


def test_infinite_depths_of_other_programs_are_no_points(tmp_path: Path) -> None:
    """The pixel at 1, 1 lies on the axis, where an infinite range has no x and y."""
    depth = np.full((3, 3), 2.0, np.float32)
    depth[1, 1], depth[0, 0] = np.inf, np.nan
    layers = {name: np.ones((3, 3), np.float32) for name in ("direct.amplitude", "direct.sigma", "status")}
    write_exr(tmp_path / "a.exr", {"direct.depth": depth, **layers})
    done = cadtof("export", tmp_path / "a.exr", "-o", tmp_path / "a.ply", "--focal-length-px", "3")
    assert (done.status, done.err) == (0, "")
    assert _ply(tmp_path / "a.ply")["z"].size == 7


@pytest.mark.parametrize("ending", [".ply", ".pcd"])
def test_truth_gives_points_without_sigma_and_status(tmp_path: Path, ending: str) -> None:
    """A depth of 0 in truth is no surface, and no point."""
    depth = np.full((3, 5), 2.0, np.float32)
    depth[0, 1], depth[2, 2] = 0.0, np.nan
    write_exr(tmp_path / "a.exr", {"direct.depth": depth, "direct.amplitude": np.full((3, 5), 0.1, np.float32)})
    optics = "--focal-length-px", 4, "--principal-point-px", "2,1"
    cloud = READERS[ending](_exported(tmp_path / f"a{ending}", tmp_path / "a.exr", *optics), FIELDS[:4])
    ranges = np.sqrt(cloud["x"] ** 2 + cloud["y"] ** 2 + cloud["z"] ** 2)
    np.testing.assert_allclose(ranges, np.full(13, 2.0), rtol=1e-6)
    np.testing.assert_allclose(cloud["amplitude"], 0.1)


def test_planar_depths_give_the_same_points(tmp_path: Path) -> None:
    ranges, planar = _maps(tmp_path / "a"), _maps(tmp_path / "b", "--depth", "z")
    clouds = [_ply(_exported(tmp_path / f"{out.parent.name}.ply", out)) for out in (ranges, planar)]
    for name in "xyz":
        np.testing.assert_allclose(clouds[0][name], clouds[1][name], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(("held", "wanted"), [("range", "z"), ("z", "range")])
def test_depths_are_written_as_the_kind_that_is_asked_for(tmp_path: Path, held: str, wanted: str) -> None:
    maps, other = (
        _maps(tmp_path / "a", "--depth", held),
        layers_of(_maps(tmp_path / "b", "--depth", wanted) / "frame_0.tif"),
    )
    with np.load(_exported(tmp_path / "a.npz", maps, "--depth", wanted)) as arrays:
        for name, plane in other.items():
            assert arrays[name].dtype == (np.uint32 if name == "status" else np.float32)
            np.testing.assert_allclose(arrays[name], plane, rtol=1e-6)
    png = _exported(tmp_path / "a.png", maps, "--depth", wanted)
    with needed_module("PIL.Image").open(png) as image:
        assert image.text["Description"].startswith("direct.depth in mm, " + {"z": "planar", "range": "radial"}[wanted])
        np.testing.assert_allclose(np.array(image), 1000.0 * np.nan_to_num(other["direct.depth"]), atol=0.51)


def test_maps_that_do_not_say_what_they_hold_are_taken_to_hold_what_is_asked_for(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", {"direct.depth": np.full((3, 4), 2.0, np.float32)})
    done = cadtof("export", tmp_path / "a.exr", "-o", tmp_path / "a.png", "--depth", "z")
    assert (done.status, "does not say which kind of depth it holds: taken for planar depth z" in done.err) == (0, True)
    with needed_module("PIL.Image").open(tmp_path / "a.png") as image:
        assert (np.array(image) == 2000).all()


def test_a_picture_in_millimetres(tmp_path: Path) -> None:
    depth = np.linspace(0.2, 70.0, 12, dtype=np.float32).reshape(3, 4)
    depth[1, 2] = np.nan
    write_exr(tmp_path / "a.exr", {"direct.depth": depth})
    png = _exported(tmp_path / "a.png", tmp_path / "a.exr")
    expected = np.where(np.nan_to_num(depth) < 65.5355, np.rint(1000 * np.nan_to_num(depth).astype(float)), 0)
    assert expected[2, 3] == expected[1, 2] == 0
    cv2 = needed_module("cv2")
    opened = cv2.imread(str(png), cv2.IMREAD_UNCHANGED)
    assert opened.dtype == np.uint16
    np.testing.assert_array_equal(opened, expected)
    with needed_module("PIL.Image").open(png) as image:
        assert (image.format, image.size) == ("PNG", (4, 3))
        assert image.text["Description"] == "direct.depth in mm, radial range; 0: no answer"
        np.testing.assert_array_equal(np.array(image), expected)


def test_arrays_and_tables_hold_every_layer(tmp_path: Path) -> None:
    out = _maps(tmp_path)
    layers = layers_of(out / "frame_0.tif")
    with np.load(_exported(tmp_path / "a.npz", out)) as arrays:
        assert set(arrays) == set(layers)
        for name, plane in layers.items():
            np.testing.assert_array_equal(arrays[name], plane)
        # bits are tested with &, which numpy offers for integers only
        assert ((arrays["status"] & 16 > 0) == np.isfinite(layers["mpi.depth"])).all()
    with _exported(tmp_path / "a.csv", out).open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    assert [int(line["x"]) for line in lines[:33]] == [*range(32), 0]
    assert int(lines[-1]["y"]) == 23
    for name, plane in layers.items():
        read = np.array([line[name] or "nan" for line in lines], np.uint32 if name == "status" else np.float32)
        np.testing.assert_array_equal(read.reshape(24, 32), plane)


def test_several_maps_get_a_file_each(tmp_path: Path) -> None:
    out = _maps(tmp_path, frames=3)
    done = cadtof("export", out, "-o", tmp_path / "cloud.ply")
    files = [tmp_path / f"cloud_frame_{index}.ply" for index in range(3)]
    assert (done.status, done.out.splitlines()) == (0, [str(file) for file in files])
    assert len(_ply(files[2])["x"]) == 24 * 32
    done = cadtof("export", out, out, "-o", tmp_path / "twice.ply")
    assert (done.status, done.out) == (2, "")
    assert " would both be written as " in done.err


def test_a_file_is_replaced_only_with_overwrite(tmp_path: Path) -> None:
    out, cloud = _maps(tmp_path), tmp_path / "cloud.ply"
    cloud.write_text("somebody's own")
    done = cadtof("export", out, "-o", cloud)
    assert (done.status, done.out) == (2, "")
    assert f"{cloud}: already exists; add --overwrite" in done.err
    assert cloud.read_text() == "somebody's own"
    assert cadtof("export", out, "-o", cloud, "--overwrite").status == 0
    assert len(_ply(cloud)["x"]) == 24 * 32


def test_no_file_is_written_if_the_name_of_one_is_too_long(tmp_path: Path) -> None:
    """A map may have a name as long as the system allows. With the name of OUT before it, that is too long."""
    (one,) = _maps(tmp_path).glob("*.tif")
    last = one.with_name("z" * 251 + ".tif")
    shutil.copy(one, last)
    refused = cadtof("export", one, last, "-o", tmp_path / "a.png")
    assert refused.status == 2
    assert refused.err.endswith("z.png: cannot be written: File name too long\n")
    assert not list(tmp_path.glob("*.png"))


def test_no_file_is_written_if_one_of_several_exists(tmp_path: Path) -> None:
    out = _maps(tmp_path, frames=3)
    (tmp_path / "table_frame_2.csv").touch()
    assert cadtof("export", out, "-o", tmp_path / "table.csv").status == 2
    assert [file.name for file in tmp_path.glob("table*")] == ["table_frame_2.csv"]


@pytest.mark.parametrize("inputs", [("-r", "rec"), ("rec/2024/cam", "rec/cam", "rec")])
def test_each_capture_has_its_own_optics(
    inputs: Sequence[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Captures in folders of the same name, and one above the others, have different lenses: so have their points."""
    monkeypatch.chdir(tmp_path)
    focal = {"2024/cam": 20.0, "cam": 40.0, ".": 80.0}
    for place, focal_px in focal.items():
        settings = record(tmp_path / "rec" / place).folder / "capture.toml"
        settings.write_text(settings.read_text().replace("= 28.0", f"= {focal_px}"))
    assert cadtof("resolve", *inputs, "-o", "out", "-j", 1, "-q", "--mpi-model", "discrete").status == 0
    for place, focal_px in focal.items():
        cloud = _ply(_exported(tmp_path / "a.ply", Path("out") / place / "frame_0.tif", "--overwrite"))
        columns = cloud["x"].astype(np.float64) / cloud["z"] * focal_px + 15.0
        np.testing.assert_allclose(columns, np.round(columns), atol=1e-3, err_msg=place)
        assert (round(columns.min()), round(columns.max())) == (0, 31), place


def test_hostile_names_and_given_optics(tmp_path: Path) -> None:
    """A line break in a file's name must not become a line of a header."""
    plane = np.full((3, 5), 2.0, np.float32)
    file = tmp_path / "a\nend_header\n.exr"
    layers = {f"direct.{name}": plane for name in ("depth", "amplitude", "sigma")}
    write_exr(file, {**layers, "status": np.full((3, 5), 8, np.uint32)})
    for ending, read in READERS.items():
        out = _exported(tmp_path / f"a{ending}", file, "--focal-length-px", 4, "--principal-point-px", "2,1")
        cloud = read(out)
        assert len(cloud["x"]) == 15
        assert (cloud["x"][7], cloud["y"][7], cloud["z"][7]) == (0.0, 0.0, 2.0)
        assert cloud["x"][5] == pytest.approx(-2.0 * 0.5 / np.sqrt(1.25))


def test_impossible_exports_are_refused(tmp_path: Path) -> None:
    out = _maps(tmp_path)
    layers = dict.fromkeys(("direct.depth", "direct.amplitude", "direct.sigma", "status"), np.ones((3, 4), np.float32))
    write_exr(tmp_path / "lone.exr", layers)
    write_exr(tmp_path / "truth.exr", {"direct.depth": np.ones((3, 4), np.float32)})
    for arguments, message in (
        (
            (out, "-o", tmp_path / "a.obj"),
            "-o: found 'a.obj', expected a name that ends with .ply, .pcd, .png, .npz, .csv",
        ),
        (
            (out, "-o", tmp_path / "a.ply", "--layer", "confidence"),
            "--layer: found 'confidence', expected a layer of depths",
        ),
        ((out, "-o", tmp_path / "a.ply", "--layer", "path3.depth"), "expected path3.depth"),
        ((tmp_path / "lone.exr", "-o", tmp_path / "a.ply"), "its optics are unknown"),
        ((tmp_path / "truth.exr", "-o", tmp_path / "a.ply"), "its optics are unknown"),
        ((tmp_path / "truth.exr", "-o", tmp_path / "a.ply", "--layer", "mpi.depth"), "expected mpi.depth"),
        ((out, "-o", tmp_path / "a.ply", "--focal-length-px", "0"), "optics.focal_length_px"),
        (
            (out, "-o", tmp_path / "a.ply", "--principal-point-px", "1,2,3"),
            "found 3, expected 2 values (X,Y)",
        ),
        ((tmp_path / "gone", "-o", tmp_path / "a.ply"), "no such file or folder; expected maps"),
        ((out, "-o", tmp_path / "gone" / "a.ply"), "cannot be written: No such file or directory"),
    ):
        done = cadtof("export", *arguments)
        assert (done.status, done.out) == (2, "")
        assert message in done.err
    assert not list(tmp_path.glob("a.*"))


def test_a_table_of_a_large_map_takes_little_memory(tmp_path: Path) -> None:
    """As texts, all values of a map would take 50 times the memory of the map."""
    depth = np.random.default_rng(5).uniform(1.0, 5.0, (400, 500)).astype(np.float32)
    file = write_exr(tmp_path / "a.exr", {"direct.depth": depth})
    tracemalloc.start()
    try:
        _exported(tmp_path / "a.csv", file)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 10 * depth.nbytes
    values = np.loadtxt(tmp_path / "a.csv", np.float32, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(values[:, 2].reshape(depth.shape), depth)
