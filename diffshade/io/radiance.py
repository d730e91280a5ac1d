"""Radiance HDR (.hdr, .pic): linear RGB with a shared exponent.

The header is read here, because libraries drop what it says; the pixels by imagecodecs, with
mantissa m and exponent e as m 2^(e - 136) (Radiance's own programs add half a step to m).
"""

import re

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.decoded import Decoded
from diffshade.io.encoding import Encoding
from diffshade.io.limits import check_size

__all__ = ["read"]

_MANTISSA_BITS = 8


def read(data: bytes) -> Decoded:
    """Radiance, with the exposure undone that the header names (EXPOSURE, COLORCORR)."""
    import imagecodecs

    header, _, rest = data.partition(b"\n\n")
    resolution, _, scanlines = rest.partition(b"\n")
    entries = [line.partition("=")[::2] for line in header.decode("latin-1").splitlines()[1:]]
    pixel_format = dict(entries).get("FORMAT", "32-bit_rle_rgbe").strip()
    if pixel_format != "32-bit_rle_rgbe":
        raise BadInput(f"has the pixel format {pixel_format!r}; save it as 32-bit_rle_rgbe")
    size = re.fullmatch(rb"-Y (\d+) \+X (\d+)", resolution.strip())
    if size is None:
        order = resolution[:40].decode("ascii", "backslashreplace")
        raise BadInput(f"has the scanline order {order!r}; save it as -Y HEIGHT +X WIDTH")
    check_size((*map(int, size.groups()), 3))
    # A plain header: the library takes FORMAT only where it expects it.
    plain = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %s +X %s\n" % size.groups()
    values = imagecodecs.rgbe_decode(plain + scanlines)
    with np.errstate(over="ignore"):  # what is infinite then is refused as such
        values /= _exposure(entries)
    return Decoded(values, full_code=None, bits=_MANTISSA_BITS, encoding=Encoding.LINEAR)


def _exposure(entries: list[tuple[str, str]]) -> np.ndarray:
    """The factor by which each channel was multiplied; the entries accumulate."""
    factor = np.ones(3)
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        for key, value in entries:
            if key in ("EXPOSURE", "COLORCORR"):
                factor *= [float(number) for number in value.split()]
        single = factor.astype(np.float32)
    if not np.all(np.isfinite(single) & (single > 0)):
        raise BadInput(f"has the exposure {factor.tolist()}; it must be above 0: mend the header")
    return single
