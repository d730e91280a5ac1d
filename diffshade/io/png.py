"""PNG (ISO/IEC 15948): pixels through libpng, what the file says about them from its chunks.

libpng passes stored values on and applies no gamma; 1, 2 and 4-bit grey come out as 8-bit codes
of the same brightness, palettes as their 8-bit colours, tRNS as an alpha channel.
"""

import struct
import zlib

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.decoded import Decoded, Samples, with_channels
from diffshade.io.encoding import Encoding
from diffshade.io.limits import check_size

__all__ = ["SIGNATURE", "read", "write"]

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_END_OF_IHDR = len(SIGNATURE) + 12 + 13
_PALETTE = 3
_CHANNELS = {0: 1, 2: 3, _PALETTE: 4, 4: 2, 6: 4}
"""Of each colour type, at most."""
_CICP_TRANSFER = {8: Encoding.LINEAR, 13: Encoding.DISPLAY}


def read(data: bytes) -> Decoded:
    """Samples of a still PNG; raises `BadInput` for a damaged or animated one."""
    import imagecodecs

    chunks = _chunks(data)
    if b"acTL" in chunks:
        raise BadInput("is an animated PNG; save one frame as a plain PNG")
    width, height, depth, colour_type = struct.unpack_from(">IIBB", chunks[b"IHDR"])
    check_size((height, width, _CHANNELS[colour_type]))
    samples = with_channels(imagecodecs.png_decode(data))
    return Decoded(
        samples=samples,
        full_code=int(np.iinfo(samples.dtype).max),
        bits=8 if colour_type == _PALETTE else depth,
        encoding=_declared_encoding(chunks),
    )


def write(samples: Samples, encoding: Encoding) -> bytes:
    """A PNG of uint8 or uint16 samples, C = 1 or 3, that says how they are encoded."""
    import imagecodecs

    grey = samples.shape[-1] == 1
    data = bytes(imagecodecs.png_encode(samples[..., 0].copy() if grey else samples))
    return data[:_END_OF_IHDR] + _encoding_chunk(encoding) + data[_END_OF_IHDR:]


def _chunks(data: bytes) -> dict[bytes, bytes]:
    """The first chunk of each type, all checksums verified up to IEND."""
    found: dict[bytes, bytes] = {}
    position = len(SIGNATURE)
    while b"IEND" not in found:
        if position + 12 > len(data):
            raise BadInput("is truncated: a PNG ends with IEND; copy or export it again")
        length, name = struct.unpack_from(">I4s", data, position)
        end = position + 8 + length
        if end + 4 > len(data):
            raise BadInput(f"is truncated in its {_printable(name)} chunk; copy or export it again")
        (checksum,) = struct.unpack_from(">I", data, end)
        if checksum != zlib.crc32(data[position + 4 : end]):
            raise BadInput(f"is damaged in its {_printable(name)} chunk; copy or export it again")
        found.setdefault(name, data[position + 8 : end])
        position = end + 4
    return found


def _declared_encoding(chunks: dict[bytes, bytes]) -> Encoding:
    """Precedence as in the third edition of the standard: cICP, iCCP, sRGB, gAMA.

    gAMA holds the exponent that led from light to sample, times 100000: 100000 is linear (as
    POV-Ray writes it for File_Gamma=1.0), 45455 is 1/2.2. ICC profiles are not interpreted.
    """
    if b"cICP" in chunks:
        return _CICP_TRANSFER.get(chunks[b"cICP"][1], Encoding.UNKNOWN)
    if b"iCCP" in chunks:
        return Encoding.UNKNOWN
    if b"sRGB" in chunks:
        return Encoding.DISPLAY
    if b"gAMA" in chunks:
        exponent = int.from_bytes(chunks[b"gAMA"], "big") / 100000
        if abs(exponent - 1) < 0.01:
            return Encoding.LINEAR
        if abs(exponent - 1 / 2.2) < 0.01:
            return Encoding.DISPLAY
    return Encoding.UNKNOWN


def _encoding_chunk(encoding: Encoding) -> bytes:
    match encoding:
        case Encoding.LINEAR:
            return _chunk(b"gAMA", struct.pack(">I", 100000))
        case Encoding.DISPLAY:
            return _chunk(b"sRGB", b"\x00")
        case Encoding.UNKNOWN:
            return b""


def _chunk(name: bytes, content: bytes) -> bytes:
    checksum = zlib.crc32(name + content)
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", checksum)


def _printable(name: bytes) -> str:
    return name.decode("ascii", "backslashreplace")
