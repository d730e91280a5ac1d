"""Each format, from files made by other means than those that read them.

PNG, TIFF, DNG and Radiance are put together by hand; JPEG is read through Pillow and made by
libjpeg; compressed TIFF is read through imagecodecs and made by Pillow.
"""

import io
import struct
import sys
import zlib
from pathlib import Path
from typing import Literal

import imagecodecs
import numpy as np
import OpenEXR
import PIL.Image
import pytest
from handmade import (
    F32,
    GREY,
    GREY_ALPHA,
    HEIGHT,
    PALETTE,
    RGB,
    RGBA,
    U8,
    U16,
    WIDTH,
    chunk,
    dng,
    gama,
    png,
    png_of,
    radiance,
    refusal,
    rgbe_and_values,
    saved,
    tiff,
    write_channels,
)

from diffshade.io import exr
from diffshade.io.formats import identify
from diffshade.io.image import Encoding, Format, read_image, read_mask

# --- PNG


@pytest.mark.parametrize(("codes", "bits"), [(U8, 8), (U16, 16)])
def test_png_is_scaled_by_its_encoding(tmp_path: Path, codes: np.ndarray, bits: int) -> None:
    image = read_image(saved(tmp_path, png_of(codes, RGB)))
    assert np.array_equal(image.values, codes / np.float32(2**bits - 1))
    assert (image.values.dtype, image.bits, image.format) == (np.float32, bits, Format.PNG)
    assert (image.full_scale, image.alpha, image.encoding) == (1.0, None, Encoding.UNKNOWN)


def test_dark_png_is_not_stretched(tmp_path: Path) -> None:
    dark = np.array([[0, 655]], np.uint16)
    assert read_image(saved(tmp_path, png_of(dark, GREY))).values.max() == np.float32(655 / 65535)


@pytest.mark.parametrize("depth", [1, 2, 4])
def test_grey_png_of_few_bits(tmp_path: Path, depth: int) -> None:
    image = read_image(saved(tmp_path, png([b"\x1b", b"\xe4"], 8 // depth, depth, GREY)))
    bits = np.unpackbits(np.array([[0x1B], [0xE4]], np.uint8), axis=1).reshape(2, -1, depth)
    codes = bits @ (1 << np.arange(depth)[::-1])
    np.testing.assert_allclose(image.values[..., 0], codes / (2**depth - 1), rtol=1e-6)
    assert image.bits == depth


def test_palette_png(tmp_path: Path) -> None:
    colours = chunk(b"PLTE", bytes([255, 0, 0, 0, 51, 0]))
    image = read_image(saved(tmp_path, png([b"\x40"], 2, 1, PALETTE, colours)))
    np.testing.assert_allclose(image.values, [[[1.0, 0.0, 0.0], [0.0, 0.2, 0.0]]])
    assert image.bits == 8


@pytest.mark.parametrize(("colour_type", "channels"), [(GREY_ALPHA, 1), (RGBA, 3)])
def test_alpha_is_dropped_where_opaque_and_apart_where_not(
    tmp_path: Path, colour_type: int, channels: int
) -> None:
    codes = U16[..., [0, 1, 2, 0]][..., : channels + 1].copy()
    image = read_image(saved(tmp_path, png_of(codes, colour_type)))
    assert image.alpha is not None
    assert np.array_equal(image.alpha, codes[..., -1] / np.float32(65535))
    codes[..., -1] = 65535
    opaque = read_image(saved(tmp_path, png_of(codes, colour_type)))
    assert opaque.alpha is None
    assert np.array_equal(opaque.values, codes[..., :-1] / np.float32(65535))


@pytest.mark.parametrize(
    ("declared", "encoding"),
    [
        (gama(1.0), Encoding.LINEAR),  # POV-Ray with File_Gamma=1.0
        (gama(1 / 2.2), Encoding.DISPLAY),
        (gama(1 / 1.8), Encoding.UNKNOWN),
        (chunk(b"sRGB", b"\0") + gama(1 / 2.2), Encoding.DISPLAY),
        (chunk(b"iCCP", b"any\0\0" + zlib.compress(b"profile")) + gama(1.0), Encoding.UNKNOWN),
        (chunk(b"cICP", bytes([1, 8, 0, 1])), Encoding.LINEAR),
        (chunk(b"cICP", bytes([1, 13, 0, 1])), Encoding.DISPLAY),
        (b"", Encoding.UNKNOWN),
    ],
)
def test_png_encoding_is_what_its_chunks_say(
    tmp_path: Path, declared: bytes, encoding: Encoding
) -> None:
    image = read_image(saved(tmp_path, png_of(U8, RGB, declared)))
    assert image.encoding is encoding
    assert np.array_equal(image.values, U8 / np.float32(255))


def test_animated_png_is_refused(tmp_path: Path) -> None:
    assert "animated" in refusal(saved(tmp_path, png_of(U8, RGB, chunk(b"acTL", bytes(8)))))


# --- JPEG


@pytest.mark.parametrize("channels", [1, 3])
def test_jpeg_is_display_referred(tmp_path: Path, channels: int) -> None:
    ramp = np.tile(np.arange(0, 256, 4, dtype=np.uint8)[:, None], (32, 1, channels)).squeeze()
    image = read_image(
        saved(tmp_path, imagecodecs.jpeg8_encode(np.ascontiguousarray(ramp), level=100))
    )
    assert image.values.shape == (32, 64, channels)
    np.testing.assert_allclose(image.values, ramp.reshape(32, 64, channels) / 255, atol=2 / 255)
    assert (image.encoding, image.full_scale, image.bits) == (Encoding.DISPLAY, 1.0, 8)


def test_cmyk_jpeg_is_refused(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    PIL.Image.new("CMYK", (8, 8)).save(buffer, "jpeg")
    assert "CMYK" in refusal(saved(tmp_path, buffer.getvalue()))


# --- TIFF


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("codes", [U8, U16, U16[..., 0], U16.astype(np.uint32) << 13])
def test_integer_tiff(tmp_path: Path, codes: np.ndarray, order: Literal["<", ">"]) -> None:
    bits = 8 * codes.dtype.itemsize
    image = read_image(saved(tmp_path, tiff(codes, order=order)))
    dtype = np.float64 if bits == 32 else np.float32
    expected = (codes.reshape(HEIGHT, WIDTH, -1) / (2**bits - 1)).astype(dtype)
    assert image.values.dtype == dtype
    np.testing.assert_allclose(image.values, expected, rtol=1e-7, atol=0)
    assert (image.encoding, image.full_scale, image.bits) == (Encoding.UNKNOWN, 1.0, bits)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_float_tiff_is_untouched(tmp_path: Path, dtype: type) -> None:
    values: np.ndarray = F32.astype(dtype)
    image = read_image(saved(tmp_path, tiff(values)))
    assert np.array_equal(image.values, values)
    assert image.values.dtype == (np.float64 if dtype is np.float64 else np.float32)
    assert (image.encoding, image.full_scale) == (Encoding.LINEAR, None)


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate"])
@pytest.mark.parametrize("array", [U8, U16[..., 0], F32[..., 0]])
def test_compressed_tiff(tmp_path: Path, array: np.ndarray, compression: str) -> None:
    buffer = io.BytesIO()
    PIL.Image.fromarray(array).save(buffer, "tiff", compression=compression)
    full = 1 if array.dtype.kind == "f" else np.iinfo(array.dtype).max
    image = read_image(saved(tmp_path, buffer.getvalue()))
    assert np.array_equal(image.values, array.reshape(HEIGHT, WIDTH, -1) / np.float32(full))


def test_tiff_where_zero_is_white(tmp_path: Path) -> None:
    image = read_image(saved(tmp_path, tiff(U8[..., 0], {262: 0})))
    assert np.array_equal(image.values[..., 0], (255 - U8[..., 0]) / np.float32(255))


@pytest.mark.parametrize("compression", ["raw", "group4"])
def test_bilevel_tiff(tmp_path: Path, compression: str) -> None:
    mask, buffer = U8[..., 0] > 99, io.BytesIO()
    PIL.Image.fromarray(mask).save(buffer, "tiff", compression=compression)
    path = saved(tmp_path, buffer.getvalue())
    assert np.array_equal(read_mask(path), mask)
    assert read_image(path).bits == 1


def test_planar_tiff(tmp_path: Path) -> None:
    planes = np.ascontiguousarray(np.moveaxis(U16, -1, 0))
    path = saved(tmp_path, imagecodecs.tiff_encode(planes, photometric=2, planarconfig=2))
    assert np.array_equal(read_image(path).values, U16 / np.float32(65535))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (tiff(U8[..., 0], {262: 3}), "palette"),
        (tiff(U8[..., [0, 1, 2, 0]], {262: 5}), "CMYK"),
        (tiff(U8[..., 0].astype(np.int8)), "signed"),
        (imagecodecs.tiff_encode(U8[:, None, :, 0].copy(), photometric=1), "5 pages"),
    ],
)
def test_unusable_tiff_is_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    assert reason in refusal(saved(tmp_path, content))


# --- Radiance HDR


def test_radiance_is_linear_and_untouched(tmp_path: Path) -> None:
    rgbe, values = rgbe_and_values()
    image = read_image(saved(tmp_path, radiance(rgbe)))
    assert np.array_equal(image.values, values)
    assert image.values[0, 0].tolist() == [1.0, 0.5, 0.25]
    assert (image.encoding, image.full_scale) == (Encoding.LINEAR, None)


def test_radiance_exposure_is_undone(tmp_path: Path) -> None:
    rgbe, values = rgbe_and_values()
    header = "EXPOSURE=2.0\nFORMAT=32-bit_rle_rgbe\nGAMMA=1\nEXPOSURE= 4\nCOLORCORR=1 2 4\n"
    assert np.array_equal(
        read_image(saved(tmp_path, radiance(rgbe, header))).values, values / [8, 16, 32]
    )


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"header": "FORMAT=32-bit_rle_xyze\n"}, "32-bit_rle_xyze"),
        ({"axes": "+Y {} +X {}"}, "scanline order"),
        ({"header": "EXPOSURE=0\n"}, "exposure"),
    ],
)
def test_unusable_radiance_is_refused(tmp_path: Path, options: dict[str, str], reason: str) -> None:
    assert reason in refusal(saved(tmp_path, radiance(rgbe_and_values()[0], **options)))


# --- OpenEXR


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_channels_in_order(tmp_path: Path, dtype: type) -> None:
    planes = dict(zip("BGR", np.moveaxis(F32.astype(dtype), -1, 0)[::-1].copy(), strict=True))
    image = read_image(write_channels(tmp_path / "named.png", planes))
    assert np.array_equal(image.values, F32.astype(dtype).astype(np.float32))
    assert (image.encoding, image.full_scale) == (Encoding.LINEAR, None)
    assert (image.bits, image.format) == (8 * np.dtype(dtype).itemsize, Format.EXR)


def test_exr_luminance_and_alpha(tmp_path: Path) -> None:
    y, alpha = F32[..., 0].copy(), np.abs(F32[..., 1]).clip(0, 1)
    image = read_image(write_channels(tmp_path / "a.exr", {"Y": y, "A": alpha}))
    assert np.array_equal(image.values, y[..., None])
    assert image.alpha is not None
    assert np.array_equal(image.alpha, alpha)


def many_layers() -> dict[str, np.ndarray]:
    names = {"View.Combined": "RGB", "View.Normal": "XYZ"}
    planes = np.moveaxis(F32, -1, 0)
    return {
        f"{n}.{c}": p.copy() for n, cs in names.items() for c, p in zip(cs, planes, strict=True)
    }


def test_exr_of_many_layers_names_them(tmp_path: Path) -> None:
    path = write_channels(tmp_path / "layers.exr", many_layers())
    message = refusal(path)
    assert "View.Combined [B G R]" in message
    assert "View.Normal [X Y Z]" in message
    assert "layer=" in message
    assert "View.Normal" in refusal(path, layer="View.Normal"), "Y of X Y Z is no luminance"
    assert np.array_equal(read_image(path, layer="View.Combined").values, F32)
    assert exr.read_channels(path).keys() == many_layers().keys()


def test_exr_without_layer_is_the_one_without_a_name(tmp_path: Path) -> None:
    base = {c: p.copy() for c, p in zip("RGB", 2 * np.moveaxis(F32, -1, 0), strict=True)}
    path = write_channels(tmp_path / "a.exr", {**many_layers(), **base})
    assert np.array_equal(read_image(path).values, 2 * F32)


def test_exr_of_several_parts(tmp_path: Path) -> None:
    settings = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    tiles = {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    parts = [
        OpenEXR.Part(dict(settings), {"RGB": F32}, "left"),
        OpenEXR.Part({**settings, **tiles}, {"RGB": 2 * F32}, "right"),
    ]
    path = tmp_path / "parts.exr"
    OpenEXR.File(parts).write(str(path))
    assert "left [B G R], right [B G R]" in refusal(path)
    assert np.array_equal(read_image(path, layer="right").values, 2 * F32)
    path.write_bytes(path.read_bytes()[:-1])
    assert "truncated" in refusal(path)


def test_cropped_and_integer_exr_are_refused(tmp_path: Path) -> None:
    window = (np.zeros(2, np.int32), np.array([99, 99], np.int32))
    cropped = write_channels(tmp_path / "crop.exr", {"RGB": F32}, displayWindow=window)
    assert "cropped" in refusal(cropped)
    ids = {c: U16[..., 0].astype(np.uint32) for c in "RGB"}
    assert "integer" in refusal(write_channels(tmp_path / "id.exr", ids))


def test_truncated_exr_says_nothing_on_standard_output(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write_channels(tmp_path / "a.exr", {"RGB": F32})
    whole = path.read_bytes()
    for length in (5, 40, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        refusal(path)
    assert capfd.readouterr().out == ""


# --- camera RAW


def test_raw_is_linear_between_black_and_white(tmp_path: Path) -> None:
    pytest.importorskip("rawpy", reason="camera RAW is an extra")
    black, white, brightest = 512, 16383, 14000
    sensor = np.full((64, 64), 2512, np.uint16)
    sensor[:32] = black
    sensor[-8:] = brightest
    image = read_image(saved(tmp_path, dng(sensor, black, white)))
    assert (image.format, image.bits, image.encoding) == (Format.RAW, 14, Encoding.LINEAR)
    assert image.values.shape == (64, 64, 3)
    np.testing.assert_allclose(image.values[4:28], 0, atol=1e-4)
    np.testing.assert_allclose(image.values[36:52], 2000 / (white - black), atol=1e-4)
    exact = (brightest - black) / (white - black)
    np.testing.assert_allclose(image.values[-4:], exact, atol=1e-4)
    sensor[-8:] = white
    saturated = read_image(saved(tmp_path, dng(sensor, black, white)))
    assert (saturated.values[-4:] == saturated.full_scale).all()


def test_raw_of_two_frames_has_one_scale(tmp_path: Path) -> None:
    """Twice the light is twice the value, to the last bit, whatever the brightest of each frame."""
    pytest.importorskip("rawpy", reason="camera RAW is an extra")
    black = 512
    white = black + 65535 // 5  # so that a step of the sensor is a whole number of codes
    light = np.zeros((64, 64), np.uint16)
    light[8:] = 700
    light[40:] = 6000
    dim, bright = (
        read_image(saved(tmp_path, dng(black + k * light, black, white))).values for k in (1, 2)
    )
    assert np.array_equal(bright[12:36], 2 * dim[12:36])
    assert np.array_equal(bright[44:], 2 * dim[44:])
    np.testing.assert_array_equal(dim[12:36], np.float32(5 * 700 / 65535))
    assert (dim[:4] == 0).all()


@pytest.mark.parametrize("orientation", [1, 3, 6])
def test_raw_stands_as_the_sensor_stored_it(orientation: int, tmp_path: Path) -> None:
    pytest.importorskip("rawpy", reason="camera RAW is an extra")
    sensor = np.zeros((32, 64), np.uint16)
    sensor[:16, :32] = 9000
    turned = dng(sensor, 0, 65535, {274: (3, [orientation])})
    values = read_image(saved(tmp_path, turned)).values
    assert values.shape == (32, 64, 3)
    bright = np.argwhere(values[..., 1] > 0.1)
    assert (bright.min(axis=0) <= (1, 1)).all()
    assert (bright.max(axis=0) < (20, 36)).all()


def test_raw_is_told_from_tiff_by_its_tags() -> None:
    cfa, preview = 32803, {330: len(tiff(U8, {330: 0}))}
    directory = struct.pack("<HHHIII", 1, 262, 4, 1, cfa, 0)
    assert identify(tiff(U8)) is Format.TIFF
    assert identify(tiff(U8[..., 0], {262: cfa})) is Format.RAW
    assert identify(tiff(U8, {50706: 1})) is Format.RAW
    assert identify(tiff(U8, preview) + directory) is Format.RAW, "sensor data below a preview"


def test_raw_without_its_package_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rawpy", None)
    message = refusal(saved(tmp_path, dng(np.zeros((64, 64), np.uint16), 0, 65535)))
    assert "pip install 'diffshade[raw]'" in message
