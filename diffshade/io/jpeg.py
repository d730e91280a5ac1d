"""JPEG: 8 bits, display-referred.

Pixels stand in the order of the sensor: the orientation flag of EXIF is not applied, because
photographs of one camera that stands still must keep one orientation.

Pillow's reader of this one format, which raises where data are missing; libjpeg alone fills the rest
with grey and says nothing. Not through `imageio` or `PIL.Image.open`: their limit of size is a global
setting, and warns where a photograph is large.
"""

import warnings
from io import BytesIO

import numpy as np

from diffshade.errors import BadInput
from diffshade.io.decoded import Decoded, with_channels
from diffshade.io.encoding import Encoding
from diffshade.io.exif import shot_of
from diffshade.io.limits import check_size

__all__ = ["read"]


def read(data: bytes) -> Decoded:
    """Samples of a grey or YCbCr JPEG; raises where data are missing, refuses CMYK."""
    from PIL.JpegImagePlugin import JpegImageFile

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of metadata
        with JpegImageFile(BytesIO(data)) as image:
            check_size((image.height, image.width, len(image.getbands())))
            samples = with_channels(np.asarray(image))
            shot = shot_of(image.getexif())
    if samples.shape[-1] not in (1, 3):
        raise BadInput("is a CMYK JPEG; convert it to RGB")
    return Decoded(samples, full_code=255, bits=8, encoding=Encoding.DISPLAY, shot=shot)
