"""Cases that OpenCV, scikit-image, imageio, Pillow, vips and GDAL write, through their Python packages."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.arrays import Stored
from tests.outside.cases import SHUFFLED, Case, Writer, need, planes_of, shuffled_planes
from tests.support.captures import PLANE_NAMES


def _opencv_pages(*options: int) -> Writer:
    def write(folder: Path, frame: Stored) -> Path:
        need("cv2")
        import cv2

        assert cv2.imwritemulti(str(folder / "frame.tif"), planes_of(frame), list(options))
        return folder / "frame.tif"

    return write


def _opencv_planes(suffix: str, *options: int) -> Writer:
    def write(folder: Path, frame: Stored) -> tuple[Path, ...]:
        need("cv2")
        import cv2

        files = tuple(folder / f"{name}{suffix}" for name in PLANE_NAMES)
        for file, plane in zip(files, planes_of(frame), strict=True):
            assert cv2.imwrite(str(file), plane, list(options))
        return files

    return write


def _opencv_four_channels(folder: Path, frame: Stored) -> Path:
    need("cv2")
    import cv2

    assert cv2.imwrite(str(folder / "frame.tif"), np.stack(planes_of(frame), axis=-1))
    return folder / "frame.tif"


def _skimage(axis: int | None) -> Writer:
    def write(folder: Path, frame: Stored) -> Path:
        need("skimage")
        from skimage import io

        data = frame if axis is None else np.stack(planes_of(frame), axis=axis)
        io.imsave(folder / "frame.tif", data, check_contrast=False)
        return folder / "frame.tif"

    return write


def _imageio(axis: int | None, **options: Any) -> Writer:
    def write(folder: Path, frame: Stored) -> Path:
        need("imageio")
        import imageio.v3 as imageio

        data = frame if axis is None else np.stack(planes_of(frame), axis=axis)
        imageio.imwrite(folder / "frame.tif", data, **options)
        return folder / "frame.tif"

    return write


def _imageio_volume(folder: Path, frame: Stored) -> Path:
    need("imageio")
    import imageio.v2 as imageio

    imageio.volwrite(folder / "frame.tif", np.stack(planes_of(frame)))
    return folder / "frame.tif"


def _images(planes: Sequence[Stored]) -> list[Any]:
    need("PIL")
    from PIL import Image

    return [Image.fromarray(plane) for plane in planes]


def _pillow_pages(**options: Any) -> Writer:
    def write(folder: Path, frame: Stored) -> Path:
        first, *others = _images(planes_of(frame))
        first.save(folder / "frame.tif", save_all=True, append_images=others, **options)
        return folder / "frame.tif"

    return write


def _pillow_named(folder: Path, frame: Stored) -> Path:
    images = _images(shuffled_planes(frame))
    for name, image in zip(SHUFFLED, images, strict=True):
        image.encoderinfo = {"tiffinfo": {285: name}}
    images[0].save(folder / "frame.tif", save_all=True, append_images=images[1:], tiffinfo={285: SHUFFLED[0]})
    return folder / "frame.tif"


def _pillow_planes(suffix: str) -> Writer:
    def write(folder: Path, frame: Stored) -> tuple[Path, ...]:
        files = tuple(folder / f"{name}{suffix}" for name in PLANE_NAMES)
        for file, image in zip(files, _images(planes_of(frame)), strict=True):
            image.save(file)
        return files

    return write


def _vips_pages(**options: Any) -> Writer:
    def write(folder: Path, frame: Stored) -> Path:
        need("pyvips")
        import pyvips

        tall = pyvips.Image.new_from_array(np.concatenate(planes_of(frame)))
        tall.tiffsave(str(folder / "frame.tif"), page_height=frame.shape[2], **options)
        return folder / "frame.tif"

    return write


def _vips_bands(interpretation: str) -> Writer:
    def write(folder: Path, frame: Stored) -> Path:
        need("pyvips")
        import pyvips

        bands = pyvips.Image.new_from_array(np.stack(planes_of(frame), axis=-1), interpretation=interpretation)
        bands.tiffsave(str(folder / "frame.tif"))
        return folder / "frame.tif"

    return write


def _gdal(*, named: bool = False, overviews: bool = False, masked: bool = False, **options: Any) -> Writer:
    """Return a writer of a GeoTIFF of four bands by rasterio; `named`: the bands have names, in the order `SHUFFLED`."""

    def write(folder: Path, frame: Stored) -> Path:
        need("rasterio")
        import rasterio
        from rasterio.transform import from_origin

        planes = shuffled_planes(frame) if named else planes_of(frame)
        height, width = planes[0].shape
        profile = {"driver": "GTiff", "height": height, "width": width, "count": 4, "dtype": planes[0].dtype.name}
        place = {"transform": from_origin(0.0, 10.0, 0.1, 0.1)}
        with rasterio.open(folder / "frame.tif", "w", **profile, **place, **options) as file:
            for band, plane in enumerate(planes, start=1):
                file.write(plane, band)
                if named:
                    file.set_band_description(band, SHUFFLED[band - 1])
            if masked:
                file.write_mask(np.full((height, width), 255, np.uint8))
        if overviews:
            with rasterio.open(folder / "frame.tif", "r+") as file:
                file.build_overviews([2, 4])
        return folder / "frame.tif"

    return write


_COLOUR = "colour picture"
_TIFF_COMPRESSION = 259
_TILES: dict[str, Any] = {"tiled": True, "blockxsize": 16, "blockysize": 16}

CASES = [
    Case("OpenCV", "imwritemulti, LZW by default", _opencv_pages()),
    Case("OpenCV", "imwritemulti, float32", _opencv_pages(), "f4"),
    Case("OpenCV", "imwritemulti, uncompressed", _opencv_pages(_TIFF_COMPRESSION, 1)),
    Case("OpenCV", "imwrite, a file a plane", _opencv_planes(".tif")),
    Case("OpenCV", "imwrite, a file a plane, float64", _opencv_planes(".tif"), "f8"),
    Case("OpenCV", "imwrite of four channels (stored as RGBA)", _opencv_four_channels, refused=_COLOUR),
    Case("scikit-image", "imsave of (2, 2, Y, X)", _skimage(None)),
    Case("scikit-image", "imsave of (4, Y, X)", _skimage(0)),
    Case("scikit-image", "imsave of (Y, X, 4) (stored as RGBA)", _skimage(-1), refused=_COLOUR),
    Case("scikit-image", "imsave of (4, Y, X), float32", _skimage(0), "f4"),
    Case("imageio", "imwrite of (2, 2, Y, X)", _imageio(None)),
    Case("imageio", "imwrite of (4, Y, X)", _imageio(0)),
    Case("imageio", "imwrite, Zstandard", _imageio(0, plugin="tifffile", compression="zstd")),
    Case("imageio", "volwrite", _imageio_volume),
    Case("Pillow", "save_all, 16 bits", _pillow_pages()),
    Case("Pillow", "save_all, mode F", _pillow_pages(), "f4"),
    Case("Pillow", "save_all, int32, tiff_lzw", _pillow_pages(compression="tiff_lzw"), "i4"),
    Case("Pillow", "save_all, tiff_adobe_deflate", _pillow_pages(compression="tiff_adobe_deflate")),
    Case("Pillow", "save_all, packbits, 8 bits", _pillow_pages(compression="packbits"), "u1"),
    Case("Pillow", "page names in another order", _pillow_named),
    Case("Pillow", "a file a plane", _pillow_planes(".tif")),
    Case("vips", "tiffsave, page height", _vips_pages()),
    Case("vips", "tiffsave, tiles, deflate", _vips_pages(tile=True, compression="deflate")),
    Case("vips", "tiffsave, LZW, predictor, BigTIFF", _vips_pages(compression="lzw", predictor="horizontal", bigtiff=True)),
    Case("vips", "tiffsave, deflate, predictor, float32", _vips_pages(compression="deflate", predictor="float"), "f4"),
    Case("vips", "tiffsave, pyramid", _vips_pages(tile=True, tile_width=16, tile_height=16, pyramid=True, subifd=True)),
    Case("vips", "four bands (stored as RGBA)", _vips_bands("multiband"), refused=_COLOUR),
    Case("vips", "four bands as RGB16", _vips_bands("rgb16"), refused=_COLOUR),
    Case("GDAL (rasterio)", "four bands, by pixel", _gdal(interleave="pixel", photometric="MINISBLACK")),
    Case("GDAL (rasterio)", "four bands, by band", _gdal(interleave="band", photometric="MINISBLACK")),
    Case("GDAL (rasterio)", "band names in another order", _gdal(named=True, photometric="MINISBLACK")),
    Case("GDAL (rasterio)", "tiles, LZW, predictor", _gdal(**_TILES, compress="lzw", predictor=2)),
    Case("GDAL (rasterio)", "deflate, predictor 3, float32", _gdal(compress="deflate", predictor=3), "f4"),
    Case("GDAL (rasterio)", "Zstandard, big-endian BigTIFF", _gdal(compress="zstd", BIGTIFF="YES", ENDIANNESS="BIG")),
    Case("GDAL (rasterio)", "LERC, lossless", _gdal(compress="lerc")),
    Case("GDAL (rasterio)", "with overviews and nodata", _gdal(overviews=True, nodata=0)),
    Case("GDAL (rasterio)", "with a mask in the file", _gdal(masked=True)),
    Case("GDAL (rasterio)", "photometric RGB", _gdal(photometric="RGB"), refused=_COLOUR),
]  # fmt: skip
